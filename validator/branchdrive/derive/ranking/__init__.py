"""Ranking of fixed banks: what a selector's choices are worth, looked up in executed outcomes. Pure numpy."""
