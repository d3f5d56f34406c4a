"""What a benchmark is judged on, predictions of it, and their errors."""
