"""Each way a metric breaks the contract of plugins is found and named."""

from pathlib import Path

import pytest
from support.messages import names
from support.tried_plugins import JUDGED, METRIC, broken

pytestmark = pytest.mark.usefixtures("own_environment")


def test_a_metric_that_keeps_the_contract_is_found_to_keep_it(tmp_path: Path) -> None:
    assert broken(tmp_path, "metric", METRIC, "", needs=JUDGED, better="lower") == {}


@pytest.mark.parametrize(
    ("needs", "better", "body", "rule", "named"),
    [
        (JUDGED, "lower", "value = 2 * value + 1", "runs_with_least", {"reference", "all", "image", "range="}),
        (JUDGED, "lower", "coverage = 100 * coverage", "stays_in_range", {"coverage", "image"}),
        (JUDGED, "higher", "", "prefers_the_truth", {"all", "image", "0", "better="}),
        ("()", "lower", "", "runs_with_least", {"image", "TypeError"}),
        (JUDGED, "lower", "value = 0.5 if np.isnan(value) else value", "scores_no_holes", {"0.5", "NaN"}),
        (JUDGED, "lower", "shown[:] = 0", "leaves_all_as_it_was", {"input", "copy"}),
        (JUDGED, "lower", "value = value * np.random.rand()", "leaves_all_as_it_was", {"all", "seed"}),
        (JUDGED, "lower", "np.random.seed(1)", "leaves_all_as_it_was", {"numpy's", "random"}),
        (JUDGED, "lower", "if not seen.any(): raise ValueError('empty')", "scores_no_holes", {"ValueError", "empty"}),
    ],
)
def test_each_way_a_metric_breaks_the_contract_is_named(
    tmp_path: Path, needs: str, better: str, body: str, rule: str, named: set[str]
) -> None:
    assert named <= names(broken(tmp_path, "metric", METRIC, body, needs=needs, better=better)[rule])


def test_what_a_metric_raises_of_every_image_is_said_once(tmp_path: Path) -> None:
    found = broken(tmp_path, "metric", METRIC, "raise KeyError('k')", needs=JUDGED, better="lower")
    (said,) = found["stays_in_range"].splitlines()
    assert {"KeyError", "'k'"} <= names(said)
