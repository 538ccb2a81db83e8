"""What the promises of the project are measured with."""
