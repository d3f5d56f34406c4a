"""The two-pass collector: plans groups, executes their rollouts, and writes them with the core's SDK."""
