"""Pairs against sorting all products: the same order, whatever the scores and the dropped rows."""

from itertools import product

from hypothesis import given
from hypothesis import strategies as st

from planning.pick_place.pairs import BestPairs

# Few values, so that scores and their products are often equal.
scores = st.lists(st.sampled_from([0.25, 0.5, 0.75, 1.0]), max_size=6)


def sorted_pairs(rows: list[float], columns: list[float]) -> list[tuple[int, int]]:
    everything = product(range(len(rows)), range(len(columns)))
    return sorted(everything, key=lambda pair: (-rows[pair[0]] * columns[pair[1]], *pair))


@given(scores, scores)
def test_all_pairs_come_once_best_first(rows: list[float], columns: list[float]) -> None:
    assert list(BestPairs(rows, columns)) == sorted_pairs(rows, columns)


@given(scores, scores, st.data())
def test_what_is_dropped_on_the_way_is_left_out_and_nothing_else(
    rows: list[float], columns: list[float], data: st.DataObject
) -> None:
    pairs, dropped, taken = BestPairs(rows, columns), set[int](), []
    for row, column in pairs:
        assert row not in dropped
        taken.append((row, column))
        if data.draw(st.booleans()):
            pairs.drop_row(row)
            dropped.add(row)
    kept = [pair for pair in sorted_pairs(rows, columns) if pair[0] not in dropped]
    assert [pair for pair in taken if pair[0] not in dropped] == kept


@given(scores, scores, st.data())
def test_scores_found_out_late_give_the_same_order_and_none_is_asked_for_in_vain(
    rows: list[float], columns: list[float], data: st.DataObject
) -> None:
    bounds = [row + data.draw(st.sampled_from([0.0, 0.25])) for row in rows]
    asked: list[int] = []

    def exact(row: int) -> float:
        asked.append(row)
        return rows[row]

    expected, taken = sorted_pairs(rows, columns), []
    best = max(columns, default=0.0)
    for row, column in BestPairs(bounds, columns, exact):
        taken.append((row, column))
        reached = rows[row] * columns[column]
        assert all(bounds[each] * best >= reached for each in asked)
    assert taken == expected
    assert len(asked) == len(set(asked))


def test_nothing_pairs_with_nothing() -> None:
    assert list(BestPairs([], [0.5])) == list(BestPairs([0.5], [])) == []
