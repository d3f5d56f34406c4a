"""Ranking of candidates by utility."""
