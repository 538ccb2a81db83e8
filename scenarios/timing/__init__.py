"""How long detections and trials take: timed in turns, and beside each other."""
