"""The pilot report: what a team wants to know of a dozen groups before it collects thousands."""
