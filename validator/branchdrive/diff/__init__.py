"""What tells two datasets apart; neither is judged."""
