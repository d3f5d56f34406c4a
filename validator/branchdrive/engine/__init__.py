"""The validator's engine: rules run on shards and layers, a verdict, a report."""
