"""Rules on the quality layer."""
