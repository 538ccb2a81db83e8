"""The parts of detection in a user's own images and clouds."""
