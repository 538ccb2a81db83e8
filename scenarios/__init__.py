"""What you run: `python -m scenarios.<name>`."""
