"""The servo: teleoperation that keeps away from the singular set, and streams that are watched."""
