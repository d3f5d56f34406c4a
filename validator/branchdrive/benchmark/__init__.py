"""The benchmark layer: protocol, locks, predictions, results and tables."""
