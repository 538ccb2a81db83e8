"""What the records of an evaluation come to: figures, pictures and a page."""
