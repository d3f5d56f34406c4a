"""Tables of results in Markdown, one module for each part of the results."""
