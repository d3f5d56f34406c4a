"""Conformance kit: cases as data, and the runner that holds any validator against them."""
