"""Collisions: the bodies of arms and obstacles, and the proof that none meet on the way."""
