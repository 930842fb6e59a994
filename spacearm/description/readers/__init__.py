"""Readers: one for each format of robot files; all return the same checked tree."""
