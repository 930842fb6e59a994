"""The content of a robot file: links, joints and visuals, as plain data."""
