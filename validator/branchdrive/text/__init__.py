"""Tables as values, and how they are printed: as Markdown and on a terminal."""
