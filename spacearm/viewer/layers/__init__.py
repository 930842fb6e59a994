"""Layers of the scene besides the arm: where a motion ends, obstacles, loads."""
