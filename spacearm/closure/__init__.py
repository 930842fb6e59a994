"""Closed chains: several tips that hold one target, or the fixed world."""
