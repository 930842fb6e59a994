"""Readers: one module for each format of robot files; all end in the one checked tree."""
