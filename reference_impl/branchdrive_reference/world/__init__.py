"""The simulated world: bodies in flat arrays, vehicle and traffic models, contacts, one tick at a time."""
