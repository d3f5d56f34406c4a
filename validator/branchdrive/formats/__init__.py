"""Bytes of files: Parquet, manifest, untrusted names, durable writes."""
