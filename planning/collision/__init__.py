"""What a motion touches."""
