"""Design studies computed chunk by chunk into a store."""
