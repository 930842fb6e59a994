"""Figures of everything that spacearm computes."""
