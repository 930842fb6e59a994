"""SDF: models of SDFormat, read to the same tree as a URDF."""
