"""Commands of mission design."""
