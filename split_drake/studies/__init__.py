"""What the model's ideas and its sampler's settings are worth."""
