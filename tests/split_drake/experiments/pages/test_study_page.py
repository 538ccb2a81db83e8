"""Pages of studies: a row a setting."""

import pytest

from split_drake.experiments.pages.render import render
from split_drake.experiments.pages.study_page import Figures, made_with, picture, study_page

ROWS: list[Figures] = [
    {"sampler": "langevin", "evaluations": 16, "good, %": 98.25, "seconds": 0.5},
    {"sampler": "heun", "evaluations": 8, "good, %": 91.0, "seconds": None},
]


def test_each_setting_has_a_row_that_is_sorted_by_its_numbers() -> None:
    page = study_page(
        "samplers", ROWS, ("sampler",), {"scenes": 5, "mugs": None}, [picture("a.png")]
    )
    assert [column.numeric for column in page.columns] == [False, True, True, True]
    assert [column.chosen for column in page.columns] == [True, False, False, False]
    assert page.facts == (("scenes", "5"),)
    assert page.rows[1].record == ROWS[1] and page.rows[1].cells[3].value is None
    text = render(page)
    assert '<img src="a.png" alt="a">' in text and "search all settings" in text
    # Nothing fails in a study: there is nothing to show alone.
    assert '<label hidden><input type="checkbox" id="failures">' in text


def test_rows_of_other_heads_are_refused() -> None:
    with pytest.raises(ValueError, match=r"a row has the heads \['other'\]; expected"):
        study_page("samplers", [*ROWS, {"other": 1.0}], ())
    assert study_page("nothing yet", [], ()).rows == ()


def test_a_page_says_what_made_it() -> None:
    assert set(made_with()) == {"commit", "processor"}
