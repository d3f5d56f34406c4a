"""Selectors that drive: decisions in a world, closed loop, on a population that no training route belongs to."""
