"""Each way a metric breaks the contract of plugins is found and named."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from support.tried_plugins import JUDGED, METRIC, broken

pytestmark = pytest.mark.usefixtures("own_environment")


def test_a_metric_that_keeps_the_contract_is_found_to_keep_it(tmp_path: Path) -> None:
    assert broken(tmp_path, "metric", METRIC, "", needs=JUDGED, better="lower") == ""


@pytest.mark.parametrize(
    ("needs", "better", "body", "said"),
    [
        (JUDGED, "lower", "value = 2 * value + 1", r"reference, all: image scores .*, not in 0 to 1"),
        (JUDGED, "lower", "coverage = 100 * coverage", "has coverage"),
        (JUDGED, "higher", "", "image scores 0 when perfect, .* when spoilt; see better="),
        ("()", "lower", "", "a view with an image, all: TypeError"),
        (JUDGED, "lower", "value = 0.5 if np.isnan(value) else value", "scores 0.5 of no pixel"),
        (JUDGED, "lower", "shown[:] = 0", "read-only; work on a copy|writes into its input"),
        (JUDGED, "lower", "value = value * np.random.rand()", "another score the second time"),
        (JUDGED, "lower", "np.random.seed(1)", "changes numpy's random state"),
        (JUDGED, "lower", "if not seen.any(): raise ValueError('empty')", "all NaN, all: ValueError: empty"),
    ],
)
def test_each_way_a_metric_breaks_the_contract_is_named(
    tmp_path: Path, needs: str, better: str, body: str, said: str
) -> None:
    assert re.search(said, broken(tmp_path, "metric", METRIC, body, needs=needs, better=better))


def test_what_a_metric_raises_of_every_image_is_said_once(tmp_path: Path) -> None:
    found = broken(tmp_path, "metric", METRIC, "raise KeyError('k')", needs=JUDGED, better="lower").splitlines()
    (said,) = [line for line in found if "range" in line.split(":")[0]]
    assert "KeyError: 'k'; " in said
