"""The dataset card and the licence."""
