"""Rounds: the methods of planning tried one after the other until one finds what is wished."""
