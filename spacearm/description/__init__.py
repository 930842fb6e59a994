"""What a robot file says: links, joints and what is drawn of them, as plain data."""
