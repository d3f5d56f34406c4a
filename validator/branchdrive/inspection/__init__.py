"""A quick look at a path: nothing is judged, and of large tables the footers alone are read."""
