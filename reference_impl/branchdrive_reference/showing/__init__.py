"""Contact sheets and animated views of branch groups, made of recorded images."""
