"""A branch group for the viewer of rerun: its futures on the map, with the actors of each, over time."""
