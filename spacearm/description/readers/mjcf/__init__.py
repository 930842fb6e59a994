"""MJCF: models of MuJoCo, compiled by it and read to the same tree as a URDF."""
