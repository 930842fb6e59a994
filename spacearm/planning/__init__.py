"""Planning: joint motions that lead the tip to a goal although the straight line is singular."""
