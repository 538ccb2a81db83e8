"""The parts of the physics study."""
