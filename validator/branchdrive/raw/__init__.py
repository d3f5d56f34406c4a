"""The raw layer: attempts and their streams, shard by shard."""
