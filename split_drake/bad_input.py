"""What is raised where something that a user gave cannot be used."""


class BadInputError(ValueError):
    """Something that was given cannot be used; the message names it, and what was expected.

    Commands print the message alone, without a traceback.
    """
