"""Runs in compiled code: plants and laws as it wants them, and what came of them."""
