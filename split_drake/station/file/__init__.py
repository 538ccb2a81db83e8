"""A station as a YAML file."""
