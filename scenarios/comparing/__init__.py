"""Two runs side by side: what changed between them on the same scenes."""
