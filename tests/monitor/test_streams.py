"""Streams stop and come back in vehicle time."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from links.samples import Rows, empty_rows
from monitor.settings.streams import StreamSettings
from monitor.streams import Streams

SETTINGS = StreamSettings(imu_timeout_s=1.0)


def imu(times_s: list[float]) -> Rows:
    rows = empty_rows("imu0", len(times_s))
    rows["t_us"] = np.array(times_s) * 1e6
    return rows


def test_a_stream_is_stale_from_its_timeout_until_its_next_row() -> None:
    streams = Streams(SETTINGS)
    changes = streams.step({"imu0": imu([0.0, 0.5, 3.0, 3.5])}, 10_000_000)
    assert changes == [
        (0, "imu0", True),
        (1_500_000, "imu0", False),
        (3_000_000, "imu0", True),
        (4_500_000, "imu0", False),
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
