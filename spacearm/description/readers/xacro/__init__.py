"""xacro: sources of robot descriptions expanded to URDF."""
