"""What a benchmark declares: models, tests, profiles, selectors, guards."""
