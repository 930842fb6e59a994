"""Flights of several phases, with bodies that are grasped and released."""
