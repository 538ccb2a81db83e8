"""SPLIT's network made ready for inference: the same answers, up to rounding, in less time."""
