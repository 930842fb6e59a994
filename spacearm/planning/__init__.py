"""Joint motions that arrive although the straight way is singular."""
