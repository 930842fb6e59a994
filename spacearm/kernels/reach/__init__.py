"""Bounds of the distance of a chain's tip from the system CM, proven by branch and bound."""
