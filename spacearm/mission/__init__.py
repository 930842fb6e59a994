"""Mission design: attitudes that let a path be followed, level reach, reactions, wheels."""
