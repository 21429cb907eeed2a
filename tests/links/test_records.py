"""Records to rows: damaged stamps, boots that overlap, what joins rows from other messages."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from links.catalog import Fill
from links.logs import read_dataflash
from links.logs.records import RecordRows, Records
from links.record_sources import Joined, RecordSource
from links.samples import Batch
from links.vocabulary import Rejection
from sim_feeds.dataflash import HEAD, DataflashWriter

S = 1_000_000


@pytest.fixture
def read(tmp_path: Path) -> Callable[..., Any]:
    """Content of a .BIN to its batch and its reader."""

    def run(content: bytes, chunk: int = 1 << 20) -> Any:
        file = tmp_path / "x.BIN"
        file.write_bytes(content)
        reader = read_dataflash(file, chunk=chunk)
        return Batch.concatenate(reader), reader

    return run


def speeds(*t_us: int) -> bytes:
    """A log of an engine's speed at these times, its number the value."""
    log = DataflashWriter()
    log.define("RPM", "Qff", "TimeUS,rpm1,rpm2")
    for k, t in enumerate(t_us):
        log.put("RPM", t, float(k), -1.0)
    return log.content()


def steady(first_s: float, count: int) -> list[int]:
    return [round(first_s * S) + 50_000 * k for k in range(count)]


@pytest.mark.parametrize("bit", [21, 22, 25, 27, 34, 46, 47, 50, 55, 62])
def test_one_damaged_stamp_costs_its_own_record(read: Callable[..., Any], bit: int) -> None:
    t_us = steady(1.0, 400)
    damaged = [t + (1 << bit) if k == 200 else t for k, t in enumerate(t_us)]
    batch, reader = read(speeds(*damaged))
    rows = batch.rows["spool0"]
    assert rows["speed_rpm"].tolist() == [float(k) for k in range(400) if k != 200]
    assert rows["t_us"].tolist() == [t for k, t in enumerate(t_us) if k != 200]
    assert batch.rejected["spool0", Rejection.OUT_OF_RANGE] == 1
    assert (batch.boots, reader.info.gaps) == ((), [])


def test_a_hole_is_passed_over_after_ten_records(read: Callable[..., Any]) -> None:
    t_us = steady(1.0, 100) + steady(40.0, 100)
    batch, reader = read(speeds(*t_us))
    assert len(batch.rows["spool0"]) == 200 - 9
    assert batch.boots == ()
    (gap,) = reader.info.gaps
    assert gap[0] == t_us[99]


@pytest.mark.parametrize("chunk", [100, 1 << 20])
@pytest.mark.parametrize("again_s", [1.0, 4.0, 5.9])
def test_a_second_log_whose_times_overlap_is_a_second_boot(
    read: Callable[..., Any], again_s: float, chunk: int
) -> None:
    batch, _ = read(speeds(*steady(1.0, 100)) + speeds(*steady(again_s, 100)), chunk)
    t_us = batch.rows["spool0"]["t_us"]
    assert len(batch.boots) == 1
    assert len(t_us) == 200
    assert (np.diff(t_us) > 0).all()
    assert t_us[99] < batch.boots[0] < t_us[100]


def test_a_second_log_of_the_same_boot_goes_on(read: Callable[..., Any]) -> None:
    batch, _ = read(speeds(*steady(1.0, 100)) + speeds(*steady(6.5, 100)))
    assert batch.boots == ()
    assert batch.rows["spool0"]["t_us"][100] == 6_500_000


def test_a_number_that_is_none_is_no_warning(read: Callable[..., Any]) -> None:
    """A signalling NaN complains when it is made a double."""
    content = speeds(*steady(1.0, 20))
    record = HEAD + bytes([144]) + struct.pack("<Qff", steady(1.0, 20)[7], 7.0, -1.0)
    at = content.index(record) + 11
    batch, _ = read(content[:at] + b"\x01\x00\xa0\x7f" + content[at + 4 :])
    assert batch.rejected["spool0", Rejection.NON_FINITE] == 1


# --------------------------------------------------------------------------- joined fields


def heartbeat(low: float, high: float, *, required: bool) -> RecordRows:
    """A heartbeat whose type another message tells."""
    kind = Fill("vehicle_type", ("kind",), low=low, high=high, required=required)
    source = RecordSource(
        "beat", "beat", "heartbeat", (Fill("armed", ("armed",)),), joined=(Joined("told", kind),)
    )
    return RecordRows([source], {"heartbeat": ("beat",)})


def part(message: str, column: str, place: list[int], values: list[float]) -> Records:
    columns = np.zeros(len(place), [(column, "<f8")])
    columns[column] = values
    at = np.array(place, np.int64)
    return Records(message, columns, at, (at + 1) * 50_000)


def test_a_joined_number_that_is_none_leaves_a_whole_field_zero() -> None:
    rows = heartbeat(0.0, 255.0, required=False)
    batch = rows.feed(
        [part("beat", "armed", [0, 2, 4], [1, 1, 1]), part("told", "kind", [1, 3], [1, np.nan])]
    )
    assert batch.rows["heartbeat"]["vehicle_type"].tolist() == [0, 1, 0]
    assert not batch.rejected


def test_a_row_is_not_rejected_because_what_joins_it_has_not_come_yet() -> None:
    rows = heartbeat(0.0, 255.0, required=True)
    batch = rows.feed(
        [
            part("beat", "armed", [0, 1, 3, 5], [1, 1, 1, 1]),
            part("told", "kind", [2, 4], [7, 1e9]),
        ]
    )
    assert batch.rows["heartbeat"]["vehicle_type"].tolist() == [7]
    assert dict(batch.rejected) == {("heartbeat", Rejection.OUT_OF_RANGE): 1}
