"""Rules on the model layer."""
