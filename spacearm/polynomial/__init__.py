"""Trigonometric polynomials of several angles: arrays only, no robots."""
