"""What holds of an arm whose masses, inertias and centres of mass are known in intervals only."""
