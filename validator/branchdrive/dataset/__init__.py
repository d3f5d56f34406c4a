"""Reading and writing datasets: layout, manifest, tables, staging, writers, reader and group view."""
