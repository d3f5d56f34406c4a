"""Tables as columns: views, frames of rows that are paired by key, and comparisons."""
