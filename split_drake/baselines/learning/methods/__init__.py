"""What each method learns from a batch of scenes, a file each."""
