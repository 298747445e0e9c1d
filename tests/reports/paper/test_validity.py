"""The agreement of a score with the truth, where it is known: equal orders, opposite orders, and half of the pairs."""

from dataclasses import replace

import pytest

from sucre_bench import compare
from sucre_bench.reports.paper.scores import agreements
from sucre_bench.results.rows import Row, frame

# By metric: scores of the methods, and what Kendall's tau with the true order a < b < c < d is.
SCORES = {
    "colours": ([1.0, 2.0, 3.0, 4.0], None),
    "ssim": ([5.0, 6.0, 7.0, 8.0], 1),
    "psi": ([1.0, 2.0, 3.0, 4.0], -1),
    "uiqm": ([2.0, 1.0, 3.0, 4.0], 2 / 3),
}


def test_the_agreement_is_kendalls_tau_over_scenes_whatever_is_better() -> None:
    rows = [
        Row(dataset="sea", scene=f"s{scene}", view="a", method=method, metric=metric, variant="x", value=value + scene)
        for metric, (values, _) in SCORES.items()
        for scene in range(3)
        for method, value in zip("abcd", values, strict=True)
    ]
    rows = [replace(row, better="lower" if row.metric == "psi" else "higher", time="2026-01-01") for row in rows]
    found = {each.name: each for each in agreements(compare.compare(frame(rows)), "colours")}
    assert {name.partition(":")[0]: each.tau for name, each in found.items()} == pytest.approx(
        {metric: tau for metric, (_, tau) in SCORES.items() if tau is not None}
    )
    assert {(each.n_scenes, each.low <= each.tau <= each.high) for each in found.values()} == {(3, True)}
