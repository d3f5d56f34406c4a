"""Leakage audit: whether what a model sees before the branch tells which action follows. Pure numpy."""
