"""What collectors share: a protocol of worlds, triggers, and the execution of groups."""
