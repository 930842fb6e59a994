"""The command that simulates: a run, or the phases of a flight."""
