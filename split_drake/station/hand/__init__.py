"""A table with objects that a hand without an arm takes."""
