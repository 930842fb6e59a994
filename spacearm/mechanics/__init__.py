"""Momentum, Jacobians and dynamics of a floating arm."""
