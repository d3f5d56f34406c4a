"""Rules on the rows of a shard."""
