"""Training of SPLIT and its evaluation."""
