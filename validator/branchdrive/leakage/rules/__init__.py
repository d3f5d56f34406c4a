"""Rules on the leakage audit, and on leaks of the structure of a release."""
