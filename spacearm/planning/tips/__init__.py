"""Several tips at once, or tips and the attitude of the spacecraft."""
