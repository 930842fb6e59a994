"""The arm, its configurations, tasks and wheels, as the equations need them."""
