"""Random streams and statistics that a validator recomputes, without scipy."""
