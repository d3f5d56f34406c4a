"""Metrics of predictions, their uncertainty and the tests between models. Pure numpy."""
