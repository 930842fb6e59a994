"""The arm, its configurations, its task and its wheels."""
