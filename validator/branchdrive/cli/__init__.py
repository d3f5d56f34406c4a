"""Command lines: parse, call one library function, format, return a documented exit code."""
