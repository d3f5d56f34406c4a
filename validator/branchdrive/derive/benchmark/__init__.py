"""The benchmark layer: protocol, locks, openings, predictions and the results that follow from them. Pure numpy."""
