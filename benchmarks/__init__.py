"""Benchmarks of the budgets: small, side by side, never part of the tests."""
