"""What all derived layers share: their view, comparisons of rows, and rules on their form."""
