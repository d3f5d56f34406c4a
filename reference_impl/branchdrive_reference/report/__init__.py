"""A report of a dataset in one file that opens without a network: what it holds, what is wrong, and a player."""
