"""Formulas of driving: boxes, risk, routes, histories, targets, utility."""
