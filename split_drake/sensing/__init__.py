"""A user's own cameras: their files, images and clouds."""
