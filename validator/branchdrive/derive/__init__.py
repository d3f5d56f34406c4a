"""Formulas that collectors, builders and auditors share. Pure numpy."""
