"""Cameras and bird's-eye views, rendered from what a dataset records."""
