"""Motion of a shard's attempts: poses, speeds, tracks, contacts and responses, compared and counted."""
