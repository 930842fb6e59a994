"""`spacearm plan`: the command, and how goals and obstacles are written on its line."""
