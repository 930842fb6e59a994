"""The quantities that kernels compute of a configuration; importing this imports no compiler."""

QUANTITIES = ("sigma_min", "manipulability", "condition", "determinant", "radius")
"""Their names, in the order of the arrays that hold them."""
NEARNESS = ("distance", "away")
"""Those that take the derivative of J*: a number, and a vector over the joints."""
