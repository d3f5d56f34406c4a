"""Running worlds: the tick loop, one rollout of one policy, and its recorded columns."""
