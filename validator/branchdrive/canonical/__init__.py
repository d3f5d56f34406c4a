"""The canonical layer: one record for each group and action."""
