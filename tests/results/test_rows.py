"""Rows of the score table."""

import math

from sucre_bench.results.rows import COLUMNS, Row, frame, tuples


def test_tuples_are_what_pandas_gives():
    rows = frame([Row(view=f"{n}.png", value=n / 2, n_pixels=n, time="t") for n in range(3)] + [Row(time="t")])
    ours, theirs = list(tuples(rows)), list(rows.itertuples(index=False, name=None))
    assert [repr(tuple(row)) for row in ours] == [repr(row) for row in theirs]
    assert ours[0]._fields == COLUMNS
    assert [(row.view, row.value) for row in tuples(rows, "view", "value")][1] == ("1.png", 0.5)
    assert math.isnan(ours[-1].value)
    assert list(tuples(rows[:0], "view")) == []
