"""What cameras see of a station: a scene that only they look at, and images of it."""
