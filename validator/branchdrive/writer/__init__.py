"""Crash-safe writing of raw datasets."""
