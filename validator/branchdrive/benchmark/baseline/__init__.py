"""Baselines of selections: what a lookup table, neighbours or a linear regression make of a context."""
