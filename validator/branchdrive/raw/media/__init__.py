"""Media of a shard: their files, and what bytes and pixels of images say."""
