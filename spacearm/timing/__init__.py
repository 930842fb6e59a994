"""When motions pass their rows: as fast as the motors allow, and laws that keep to it."""
