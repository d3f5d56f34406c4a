"""Audit of the derived layers: what they say, held against the raw layer and against each other."""
