"""From a `RunPage` to one HTML file, by the templates in `parts`."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from functools import lru_cache
from importlib import resources
from typing import Any

from jinja2 import Environment, FunctionLoader, StrictUndefined

from split_drake.experiments.pages.run_page import RunPage

_PARTS = resources.files("split_drake.experiments.pages") / "parts"


def render(page: RunPage) -> str:
    """Return the page; style, script and records are within it."""
    return (
        _environment()
        .get_template("run.html")
        .render(page=page, details=_script_json(_details(page)))
    )


@lru_cache(maxsize=1)
def _environment() -> Environment:
    return Environment(
        loader=FunctionLoader(_part),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def _part(name: str) -> str:
    return (_PARTS / name).read_text(encoding="utf-8")


def _details(page: RunPage) -> dict[str, Any]:
    """Return what rows show when they are opened, by their keys."""
    return {
        row.key: {
            "stills": [asdict(still) for still in row.stills],
            "tracks": [asdict(track) for track in row.tracks],
            "record": row.record,
        }
        for row in page.rows
    }


def _script_json(value: Mapping[str, Any]) -> str:
    """Return JSON that may stand in a script: nothing in it can end that."""
    text = json.dumps(value, separators=(",", ":"), default=str)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
