"""Tuples of arrays without reference counts: the same memory, and nothing is freed too soon."""

from __future__ import annotations

import sys
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.jit import borrowed, kernel

Array = NDArray[np.float64]


class State(NamedTuple):
    total: Array
    rows: Array
    step: float


@kernel
def add_rows(state: State) -> float:
    state = borrowed(state)
    last = state.rows[0]
    for i in range(state.rows.shape[0]):
        last = state.rows[i]
        state.total[:] += state.step * last
    return float(last.sum())


def test_a_borrowed_tuple_is_the_same_memory_and_keeps_its_scalars() -> None:
    state = State(np.ones(3), np.arange(6.0).reshape(2, 3), 2.0)
    assert add_rows(state) == 12.0
    np.testing.assert_array_equal(state.total, [7.0, 11.0, 15.0])
    assert borrowed(state) is state


def test_borrowing_leaves_the_owners_count_alone() -> None:
    state = State(np.ones(3), np.ones((2, 3)), 1.0)
    before = sys.getrefcount(state.total), sys.getrefcount(state.rows)
    for _ in range(100):
        add_rows(state)
    assert (sys.getrefcount(state.total), sys.getrefcount(state.rows)) == before
    assert np.isfinite(state.total).all()
