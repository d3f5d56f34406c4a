"""Derived layers as columns: what a release's tables and documents must say, computed from the layer before."""
