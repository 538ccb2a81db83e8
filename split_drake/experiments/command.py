"""Commands: their options, and one sentence where these cannot be carried out."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

import tyro

from split_drake.bad_input import BadInputError

Options = TypeVar("Options")


def run_command(
    main: Callable[[Options], object], options: type[Options], description: str | None = None
) -> None:
    """Run `main` with options from the command line.

    Args:
        main: of the command.
        options: a dataclass, whose docstring tells what each option means.
        description: of the command; the docstring of `options` where none is given.

    Raises SystemExit with one sentence where the options, or what they name, cannot be used.
    """
    asked = tyro.cli(options, description=description)
    with told_in_a_sentence():
        main(asked)


@contextmanager
def told_in_a_sentence() -> Iterator[None]:
    """Exit with the message alone where something that was given cannot be used."""
    try:
        yield
    except BadInputError as error:
        raise SystemExit(str(error)) from error
