"""Steps of the integrators: an explicit pair and two implicit methods."""
