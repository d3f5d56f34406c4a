"""The model layer: inputs and targets of the frozen population."""
