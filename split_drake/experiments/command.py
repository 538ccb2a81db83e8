"""Commands: their options, and one sentence where these cannot be carried out."""

import errno
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, TypeVar

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
    with told_in_a_sentence():
        main(tyro.cli(options, description=description))


def run_commands(
    main: Callable[[Any], object], commands: Mapping[str, type], description: str | None = None
) -> None:
    """Run `main` with the options of one of several commands; see `run_command`.

    Args:
        main: of all commands.
        commands: {name of a command: dataclass of its options}.
        description: of the commands.
    """
    with told_in_a_sentence():
        main(tyro.extras.subcommand_cli_from_dict(dict(commands), description=description))


@contextmanager
def told_in_a_sentence() -> Iterator[None]:
    """Exit with the message alone where something that was given cannot be used.

    So does what the system says of a file: that it is missing, protected, or that the disk is full.
    """
    try:
        yield
    except BadInputError as error:
        raise SystemExit(str(error)) from error
    except OSError as error:
        if error.filename is None and error.errno != errno.ENOSPC:
            raise
        where = "the disk" if error.filename is None else error.filename
        raise SystemExit(f"{where}: {error.strerror}") from error
