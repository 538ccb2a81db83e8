"""What all tests share."""

from hypothesis import settings

# Examples take as long as the machine is busy: no wall time is asserted.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")
