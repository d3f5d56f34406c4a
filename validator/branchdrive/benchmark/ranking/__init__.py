"""Ranking of candidates by utility: selectors and baselines, what their choices are worth, and what they lead to.

`ratio` has the intervals of rates and ratios over route clusters, and `noise` says which differences replays could
explain; guards take both.
"""
