"""Commands of the benchmark; each is an entry point of `branchdrive.commands`."""
