"""The dataset as files and documents."""
