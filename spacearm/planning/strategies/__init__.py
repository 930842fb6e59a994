"""Strategies of planning: each solves one kind of request, and shares search and proofs."""
