"""The leakage audit: what precedes the branch must not tell the action."""
