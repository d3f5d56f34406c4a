"""The builder of releases: layers in order, and their publication."""
