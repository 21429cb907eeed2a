"""Rows come out in time order behind the watermark, whatever the split."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from links.samples import Batch, Rows, empty_rows
from links.vocabulary import Rejection
from monitor.ordering import Ordering

HORIZON_US = 400_000


def batch(times: list[tuple[str, int]]) -> Batch:
    """Rows that arrive in the given order, one after another."""
    rows: dict[str, Rows] = {}
    for sensor in {s for s, _ in times}:
        mine = [(i, t) for i, (s, t) in enumerate(times) if s == sensor]
        rows[sensor] = empty_rows(sensor, len(mine))
        rows[sensor]["seq"], rows[sensor]["t_us"] = np.array(mine).T
    return Batch(rows)


def drain(batches: list[Batch]) -> tuple[dict[str, list[int]], Ordering]:
    ordering = Ordering(HORIZON_US, {"gps": 100_000})
    out: dict[str, list[int]] = {}
    for part in [*(ordering.feed(b.rows) for b in batches), ordering.finish()]:
        for sensor, rows in part.items():
            out.setdefault(sensor, []).extend(rows["seq"].tolist())
    return out, ordering


STREAMS = st.lists(
    st.tuples(st.sampled_from(["imu0", "gps0", "attitude"]), st.integers(0, 3_000_000)),
    min_size=1,
    max_size=60,
)


@given(STREAMS, st.lists(st.integers(0, 60), max_size=6))
def test_any_split_releases_the_same_rows_and_rejects_the_same(
    times: list[tuple[str, int]], cuts: list[int]
) -> None:
    whole, all_at_once = drain([batch(times)])
    parts, bit_by_bit = drain(batch(times).split(sorted(cuts)))
    assert parts == whole
    assert bit_by_bit.rejected == all_at_once.rejected


@given(STREAMS)
def test_every_row_is_released_once_or_counted_late(times: list[tuple[str, int]]) -> None:
    out, ordering = drain([batch(times)])
    released = sorted(s for seqs in out.values() for s in seqs)
    late = sum(ordering.rejected.values())
    assert len(set(released)) == len(released)
    assert len(released) + late == len(times)


def test_released_rows_are_in_time_order_although_they_came_otherwise() -> None:
    out, _ = drain([batch([("imu0", 300_000), ("imu0", 100_000), ("imu0", 200_000)])])
    assert out["imu0"] == [1, 2, 0]


def test_a_row_behind_the_watermark_is_late() -> None:
    times = [("imu0", 1_000_000), ("attitude", 1_000_000 - HORIZON_US - 1), ("attitude", 700_000)]
    out, ordering = drain([batch(times)])
    assert out["attitude"] == [2]
    assert ordering.rejected == {("attitude", Rejection.LATE): 1}


def test_latency_is_taken_off_before_ordering() -> None:
    ordering = Ordering(HORIZON_US, {"gps": 100_000})
    ordering.feed(batch([("gps0", 1_000_000)]).rows)
    assert ordering.finish()["gps0"]["t_us"].tolist() == [900_000]
    assert ordering.watermark_us == 900_000 - HORIZON_US


def test_a_row_that_came_twice_counts_once_and_one_that_differs_is_another() -> None:
    arrived = batch([("imu0", t) for t in (0, 25_000, 0, 50_000, 25_000, 50_000)])
    arrived.rows["imu0"]["acc_m_s2"][5, 2] = -9.8
    out, ordering = drain(arrived.split([2, 5]))
    assert out == {"imu0": [0, 1, 3, 5]}
    assert ordering.rejected == {("imu0", Rejection.DUPLICATE): 2}


def test_what_is_no_number_is_the_same_as_itself() -> None:
    arrived = batch([("imu0", 0), ("imu0", 0)])
    arrived.rows["imu0"]["acc_m_s2"] = np.nan
    out, _ = drain([arrived])
    assert out == {"imu0": [0]}


def test_texts_and_parameters_may_say_the_same_twice() -> None:
    out, ordering = drain([batch([("param", 0), ("param", 0)])])
    assert out == {"param": [0, 1]}
    assert not ordering.rejected
