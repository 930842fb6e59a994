"""Plans by which arm and wheels bring a tumbling spacecraft to rest."""
