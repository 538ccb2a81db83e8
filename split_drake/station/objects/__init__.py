"""The free objects of a station: what they stand on, and where they are put."""
