"""Tips: where an arm ends, and the joints that do not count."""
