"""Sharing what is computed of an array."""

import numpy as np

from sucre_bench.arrays import locked, once

CALLS: list[float] = []


@once
def total(array: np.ndarray, factor: float = 1.0) -> float:
    CALLS.append(factor)
    return float(array.sum() * factor)


def test_a_read_only_array_is_computed_once_for_each_argument() -> None:
    CALLS.clear()
    array = locked(np.ones(3))
    assert [total(array), total(array), total(array, 2.0), total(array, 2.0)] == [3, 3, 6, 6]
    assert CALLS == [1.0, 2.0]


def test_a_writable_array_is_computed_anew_since_it_may_have_changed() -> None:
    array = np.ones(3)
    assert total(array) == 3
    array[0] = 5
    assert total(array) == 7


def test_another_array_at_the_same_place_in_memory_gets_its_own_result() -> None:
    for value in range(50):
        assert total(locked(np.full(3, float(value)))) == 3 * value


def test_locking_keeps_a_read_only_array_as_it_is_and_the_original_writable() -> None:
    array = np.ones(3)
    view = locked(array)
    assert locked(view) is view
    array[0] = 2
    assert view[0] == 2
