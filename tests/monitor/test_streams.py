"""Streams stop and come back in vehicle time."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from links.samples import Rows, empty_rows
from monitor.settings.streams import StreamSettings
from monitor.streams import Change, Streams

SETTINGS = StreamSettings(imu_timeout_s=1.0)


def imu(times_s: list[float]) -> Rows:
    rows = empty_rows("imu0", len(times_s))
    rows["t_us"] = np.array(times_s) * 1e6
    rows["acc_m_s2"][:, 2] = -9.8
    return rows


def test_a_stream_is_stale_from_its_timeout_until_its_next_row() -> None:
    streams = Streams(SETTINGS)
    changes = streams.step({"imu0": imu([0.0, 0.5, 3.0, 3.5])}, 10_000_000)
    assert changes == [
        (0, "imu0", Change.FRESH),
        (1_500_000, "imu0", Change.STOPPED),
        (3_000_000, "imu0", Change.FRESH),
        (4_500_000, "imu0", Change.STOPPED),
    ]
    assert streams.streams["imu0"].gaps == 1
    assert streams.streams["imu0"].rate_hz == 3 / 3.5


@given(
    st.lists(st.floats(0.01, 3.0), min_size=1, max_size=30),
    st.lists(st.integers(0, 30), max_size=4),
)
def test_changes_do_not_depend_on_the_split(intervals: list[float], cuts: list[int]) -> None:
    times = np.round(np.cumsum(intervals), 3)
    whole = Streams(SETTINGS).step({"imu0": imu(times.tolist())}, int(times[-1] * 1e6) + 1)
    streams, parts = Streams(SETTINGS), []
    for piece in np.split(times, sorted(min(c, len(times)) for c in cuts)):
        if len(piece):
            parts += streams.step({"imu0": imu(piece.tolist())}, int(piece[-1] * 1e6) + 1)
    assert parts == whole


def test_an_imu_that_sends_zeros_is_blank_and_never_stops() -> None:
    streams, zeros = Streams(SETTINGS), imu([0.0, 5.0, 10.0])
    zeros["acc_m_s2"] = 0
    assert streams.step({"imu0": zeros}, 20_000_000) == [(0, "imu0", Change.BLANK)]


@given(st.integers(0, 5), st.integers(0, 5))
def test_the_first_row_that_says_something_makes_a_blank_stream_fresh(zeros: int, cut: int) -> None:
    rows = imu([0.0, 0.5, 1.0, 1.5, 2.0, 5.0])
    rows["acc_m_s2"][:zeros] = 0
    whole = Streams(SETTINGS).step({"imu0": rows}, 5_000_001)
    streams = Streams(SETTINGS)
    parts = []
    for piece in (rows[:cut], rows[cut:]):
        if len(piece):
            parts += streams.step({"imu0": piece}, int(piece["t_us"][-1]) + 1)
    assert parts == whole
    first = (
        (zeros * 500_000, "imu0", Change.FRESH) if zeros < 5 else (5_000_000, "imu0", Change.FRESH)
    )
    assert first in whole
