"""The machine-readable contract: schemas, columns, limits, policies, descriptor and rule catalogue."""
