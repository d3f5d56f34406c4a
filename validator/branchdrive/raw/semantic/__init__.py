"""Semantic maps of a shard, pixel by pixel against boxes, towns and routes."""
