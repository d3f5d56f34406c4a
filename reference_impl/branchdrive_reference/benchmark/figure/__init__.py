"""Figures of a benchmark, from its results and the documents of its release. Needs the extra ``branchdrive[plots]``."""
