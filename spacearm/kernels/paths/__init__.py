"""Compiled following: many floating arms led along paths of the tip at once (arrays only)."""
