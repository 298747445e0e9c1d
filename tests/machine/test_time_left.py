"""The time that is left, as a run estimates it."""

import pytest

from sucre_bench.machine.progress import Pace

pytestmark = pytest.mark.short


def _after(total: int, *steps: float) -> Pace:
    """The pace after steps that took so many seconds each."""
    pace, now = Pace(total, 100.0), 100.0
    for took in steps:
        now += took
        pace.advance(now)
    return pace


def test_the_first_view_with_its_imports_does_not_count():
    assert _after(100, 60.0).left_s is None
    assert _after(100, 60.0, 2.0).left_s == pytest.approx(98 * 2)
    assert _after(100, 60.0, 2.0, 4.0).left_s == pytest.approx(97 * 3)


def test_stored_views_do_not_count():
    stored = [1e-5] * 1900
    assert _after(2000, *stored).left_s is None
    assert _after(2000, *stored, 60.0).left_s is None
    assert _after(2000, *stored, 60.0, 3.0).left_s == pytest.approx(98 * 3)


def test_without_a_total_nothing_is_said():
    pace = Pace(None, 0.0)
    for now in (10.0, 20.0, 30.0):
        pace.advance(now)
    assert pace.left_s is None
