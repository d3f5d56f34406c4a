"""Fits of the selection-path guard with cvxpy. Needs the extra ``branchdrive[guard]``; what is fitted does not."""
