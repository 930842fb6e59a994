"""Motions of a floating arm: controllers, simulation, following a path of the tip."""
