"""Commands of the benchmark: train, lock, predict, evaluate, and export. Needs the extra ``branchdrive[models]``."""
