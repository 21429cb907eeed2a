"""Rows of several sensors as one stream: the order of a sort, and samples nobody can believe."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from estimators.ins_bank_events import merge, within

sensor_of_row = st.lists(st.tuples(st.integers(0, 3), st.integers(0, 5)), max_size=60)


@settings(max_examples=60, deadline=None)
@given(sensor_of_row)
def test_a_merge_is_the_sort_by_time_and_arrival(rows: list[tuple[int, int]]) -> None:
    """Times repeat often, a sensor may have no rows, arrival is not in the order of time."""
    parts = [[(t, n) for n, (s, t) in enumerate(rows) if s == sensor] for sensor in range(4)]
    flat = [row for part in parts for row in sorted(part)]
    t_us, seq = (np.array([row[i] for row in flat], np.int64) for i in range(2))
    edge = np.cumsum([0, *(len(part) for part in parts)])
    values = np.arange(2.0 * len(flat)).reshape(-1, 2)
    kinds = np.array([7, 3, 5, 1])
    t_s, kind, got = merge(t_us, seq, values, edge, kinds)
    order = np.lexsort((seq, t_us))
    np.testing.assert_array_equal(t_s, t_us[order] * 1e-6)
    np.testing.assert_array_equal(kind, np.repeat(kinds, np.diff(edge))[order])
    np.testing.assert_array_equal(got, values[order])


def test_samples_beyond_the_limits_or_not_finite_are_not_believed() -> None:
    values = np.zeros((6, 8))
    values[0, :6] = 9.0
    values[1, 2], values[2, 5], values[3, 0], values[4, 3] = -500.0, 60.0, np.nan, -np.inf
    values[5, 6:] = 1e9
    np.testing.assert_array_equal(within(values, 500.0, 60.0), [1, 0, 0, 0, 0, 1])
