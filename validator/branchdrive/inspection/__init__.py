"""What lies at a path, told in a moment: nothing is judged, and of large tables the footers alone are read."""
