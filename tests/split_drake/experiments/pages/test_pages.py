"""Pages of runs, as text."""

import json
import re
from dataclasses import replace

import pytest

from split_drake.experiments.pages.plots import bars_of, rates_along
from split_drake.experiments.pages.render import render
from split_drake.experiments.pages.run_page import (
    Bar,
    Cell,
    Column,
    Link,
    Piece,
    Row,
    RunPage,
    Track,
    failures_first,
)
from split_drake.experiments.statistics import Rate

TRACK = Track("attempt 1, hang", "grasp: slipped", False, (Piece("close", 1.2, "5 mm", False),))


def row(key: str, good: bool) -> Row:
    cells = (Cell(float(key)), Cell("a </script> & b"), Cell("yes", good=good))
    still = Link("stills/0.webp", "the end")
    return Row(key, good, cells, still, (still,), (TRACK,), (Link("r.html", "replay"),), {"n": key})


PAGE = RunPage(
    title="hang & more",
    facts=(("commit", "abc"),),
    bars=(Bar.of("all", Rate(3, 4)), Bar.of("none", Rate(0, 0))),
    plots=(bars_of("failures", {"grasp": 2}),),
    columns=(Column("trial", numeric=True), Column("mug", chosen=True), Column("outcome")),
    rows=failures_first([row("0", True), row("1", False)]),
    thing="trial",
)


def test_a_page_shows_all_and_escapes_it() -> None:
    shown = render(PAGE)
    assert "<title>hang &amp; more</title>" in shown
    assert "3/4 = 75.0%" in shown and "no trials" in shown
    assert shown.index('id="trial-1"') < shown.index('id="trial-0"'), "failures come first"
    assert "a &lt;/script&gt; &amp; b" in shown
    assert shown.count("</script>") == 2, "records cannot end the script that they are in"
    assert 'src="stills/0.webp"' in shown and '<a href="r.html">replay</a>' in shown
    details = re.search(r'id="details">(.*?)</script>', shown, re.DOTALL)
    assert details is not None
    found = json.loads(details[1])
    assert found["1"]["tracks"][0]["pieces"][0] == {
        "name": "close",
        "seconds": 1.2,
        "felt": "5 mm",
        "good": False,
    }


def test_nothing_is_loaded_from_elsewhere() -> None:
    addresses = re.findall(r"(?:src|href)=\"([^\"]+)\"", render(PAGE))
    assert all("//" not in address for address in addresses if not address.startswith("#"))


def test_rows_fit_the_columns_and_have_keys_of_their_own() -> None:
    with pytest.raises(ValueError, match="row 0 has 2 cells; expected 3"):
        replace(PAGE, rows=(replace(PAGE.rows[1], cells=(Cell(0), Cell(1))),))
    with pytest.raises(ValueError, match="two rows have the same key"):
        replace(PAGE, rows=PAGE.rows[:1] * 2)


def test_plots_are_the_same_for_the_same_values() -> None:
    made = [
        rates_along("width, mm", [10.0, 20.0, 70.0], [True, False, True], (0.0, 50.0, 100.0))
        for _ in range(2)
    ]
    assert made[0].startswith("<svg") and "script" not in made[0]
    assert re.sub(r'"#?[mp][0-9a-f]+"|url\(#[^)]+\)', "", made[0]) == re.sub(
        r'"#?[mp][0-9a-f]+"|url\(#[^)]+\)', "", made[1]
    )
    assert bars_of("a", {"x": 1.0}) != bars_of("a", {"x": 2.0})
