"""Which distances and points a floating arm reaches, and where singularities are."""
