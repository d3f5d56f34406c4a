"""What the leakage audit takes from outside of the core: recurrent classifiers, and the check of the gate's size."""
