"""What a shard of the raw layer says to the derived layers: one frame per table, as far as one shard can tell."""
