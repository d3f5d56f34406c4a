"""The quality layer: fidelity, split, population and ledger."""
