"""All commands: what cannot be used is told in a sentence, and no number is taken that is none."""

import ast
import dataclasses
import importlib
import sys
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import pytest

from split_drake.bad_input import BadInputError
from split_drake.experiments.command import run_command, run_commands
from split_drake.files import read_json

ROOT = Path(__file__).parents[1]
PACKAGES = ("models", "split_drake", "planning", "scenarios")
ENTRIES = ("run_command", "run_commands")


def command_files() -> list[Path]:
    """Return all files that are run by `python -m`."""
    paths = sorted(path for name in PACKAGES for path in (ROOT / name).rglob("*.py"))
    return [path for path in paths if 'if __name__ == "__main__":' in path.read_text()]


def calls_in_main(path: Path) -> list[ast.Call]:
    """Return what a file calls where it is run."""
    (block,) = (
        node
        for node in ast.parse(path.read_text()).body
        if isinstance(node, ast.If) and ast.unparse(node.test) == "__name__ == '__main__'"
    )
    return [node.value for node in block.body if isinstance(node, ast.Expr)]  # type: ignore[misc]


def module_of(path: Path) -> types.ModuleType:
    return importlib.import_module(".".join(path.relative_to(ROOT).with_suffix("").parts))


def options_of(path: Path) -> list[type]:
    """Return the dataclasses of a command's options, which its last call names."""
    call = calls_in_main(path)[-1]
    named = call.args[1]
    values = named.values if isinstance(named, ast.Dict) else [named]
    return [getattr(module_of(path), ast.unparse(value)) for value in values]


# What draws the meshes of the robot's models asks for nothing.
COMMANDS = [path for path in command_files() if path.name != "panda_meshes.py"]


@pytest.mark.parametrize("path", COMMANDS, ids=lambda path: str(path.relative_to(ROOT)))
def test_commands_are_run_where_mistakes_are_told_in_a_sentence(path: Path) -> None:
    name = ast.unparse(calls_in_main(path)[-1].func)
    assert name in ENTRIES


def given(hint: Any, file: Path) -> Any:
    """Return a value for an option that has no default."""
    if get_origin(hint) in (Union, types.UnionType):
        hint = get_args(hint)[0]
    if get_origin(hint) is Literal:
        return get_args(hint)[0]
    if get_origin(hint) is tuple:
        return (given(get_args(hint)[0], file),)
    return {Path: file, str: "mugs", int: 1, float: 1.0}[hint]


def made(options: type, file: Path) -> Any:
    """Return options with their defaults, and with something where there is none."""
    hints = get_type_hints(options)
    asked = {
        entry.name: given(hints[entry.name], file)
        for entry in dataclasses.fields(options)
        if entry.default is dataclasses.MISSING and entry.default_factory is dataclasses.MISSING
    }
    names = {entry.name for entry in dataclasses.fields(options)}
    if options.__name__ == "TrainConfig":
        asked["steps"] = 1
    if "checkpoint" in names:
        asked["checkpoint"] = file
    return options(**asked)


def wrong_numbers(record: Any) -> Iterator[tuple[str, Any]]:
    """Yield (where, a function that makes the record with a number there that is none)."""
    for entry in dataclasses.fields(record):
        value = getattr(record, entry.name)
        wrong: tuple[float, ...] = ()
        if isinstance(value, float) or entry.type in (float, float | None):
            wrong = (float("nan"), float("inf"), -float("inf"), 1e38)
        elif entry.type in (int, int | None):
            wrong = (1.5, float("nan"), True)
        for number in wrong:
            changed: dict[str, float | None] = {entry.name: number}
            if type(record).__name__ == "TrainConfig" and entry.name == "minutes":
                changed["steps"] = None
            yield f"{entry.name}={number}", lambda c=changed: dataclasses.replace(record, **c)
        if dataclasses.is_dataclass(value):
            yield from ((f"{entry.name}.{name}", make) for name, make in wrong_numbers(value))


@pytest.mark.parametrize("path", COMMANDS, ids=lambda path: str(path.relative_to(ROOT)))
def test_numbers_of_all_options_are_numbers(path: Path, tmp_path: Path) -> None:
    file = tmp_path / "some.html"
    file.touch()
    for options in options_of(path):
        for where, make in wrong_numbers(made(options, file)):
            with pytest.raises(ValueError, match=r"expected") as caught:
                make()
            assert where.split("=")[0].split(".")[-1] in str(caught.value).replace("-", "_")


@dataclasses.dataclass(frozen=True)
class CountOptions:
    """Counting.

    Attributes:
        count: to count to.
    """

    count: int = 3

    def __post_init__(self) -> None:
        if self.count == 4:
            raise BadInputError("count is 4; expected less")
        if self.count == 5:
            raise FileNotFoundError(2, "No such file or directory", "five.txt")


def told(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> object:
    """Return what the process would end with."""
    monkeypatch.setattr(sys, "argv", ["count", *arguments])
    with pytest.raises(SystemExit) as stopped:
        run_command(lambda _: read_json("no.json", "a count"), CountOptions)
    return stopped.value.code


def test_mistakes_before_and_in_main_are_told_in_a_sentence(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert told(monkeypatch) == "there is no file no.json; expected a count"
    assert told(monkeypatch, "--count", "4") == 2
    shown = capsys.readouterr().err
    assert "count is 4; expected less" in shown
    assert "Traceback" not in shown
    assert told(monkeypatch, "--count", "5") == "five.txt: No such file or directory"


def test_one_of_several_commands_is_run_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["count", "up", "--count", "2"])
    counted: list[int] = []
    run_commands(lambda asked: counted.append(asked.count), {"up": CountOptions, "to": int})
    assert counted == [2]
    monkeypatch.setattr(sys, "argv", ["count", "up"])
    with pytest.raises(SystemExit, match=r"there is no file no.json"):
        run_commands(lambda _: read_json("no.json", "a count"), {"up": CountOptions, "to": int})
