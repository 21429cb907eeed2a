"""A report reads the same numbers from files as from memory, and only those that it asks for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from monitor.estimate_files import EstimateFiles
from monitor.report.tables import MemoryTables, ParquetTables, Tables
from monitor.traces import MEASURED
from monitor.verdict import AIR_ESTIMATE

pytest.importorskip("pyarrow")

EVER = (-(1 << 60), 1 << 60)


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> tuple[MemoryTables, ParquetTables]:
    rng = np.random.default_rng(1)
    tables = {"air": np.zeros(50, AIR_ESTIMATE), "measured_imu0": np.zeros(70, MEASURED["imu"])}
    for rows in tables.values():
        for name in rows.dtype.names:
            rows[name] = rng.normal(0.0, 1.0, rows[name].shape)
        rows["t_us"] = np.arange(len(rows)) * 100
    folder = tmp_path_factory.mktemp("tables") / "estimates"
    with EstimateFiles(folder, {}, rows_at_once=8) as files:
        for begin in range(0, 70, 5):
            files.add({name: rows[begin : begin + 5] for name, rows in tables.items()})
        files.finish({})
    return MemoryTables(tables), ParquetTables(folder)


def column(tables: Tables, name: str, what: str, from_us: int, to_us: int) -> np.ndarray:
    """Values of a column within a time."""
    parts = list(tables.read(name, ("t_us", what), from_us, to_us))
    t_us, values = (np.concatenate([p[k] for p in parts]) for k in (0, 1))
    return values[(t_us >= from_us) & (t_us <= to_us)]


def test_files_and_memory_have_the_same(both) -> None:
    memory, files = both
    assert memory.names() == files.names() == ["air", "measured_imu0"]
    assert memory.until_us() == files.until_us() == 6900
    for name in memory.names():
        assert memory.columns(name) == files.columns(name)
        for what in memory.columns(name):
            for span in (EVER, (0, 0), (310, 1250), (6000, 9999)):
                if name == "air" and span[0] == 6000:
                    continue
                np.testing.assert_array_equal(
                    column(memory, name, what, *span), column(files, name, what, *span)
                )


def test_only_the_row_groups_of_the_time_are_read(both) -> None:
    _, files = both
    pieces = list(files.read("measured_imu0", ("t_us",), 3000, 3300))
    assert sum(len(t_us) for (t_us,) in pieces) <= 20
    assert list(files.read("measured_imu0", ("t_us",), 8000, 9000)) == []


def test_what_is_not_there_is_not_there(both) -> None:
    for tables in both:
        assert tables.columns("wing") == []
        with pytest.raises(KeyError):
            next(tables.read("wing", ("t_us",), *EVER))
        with pytest.raises(KeyError):
            next(tables.read("air", ("t_us", "cas"), *EVER))


def test_no_table_at_all_is_no_error(tmp_path: Path) -> None:
    assert MemoryTables({}).until_us() is None
    assert ParquetTables(tmp_path / "none").until_us() is None
    assert ParquetTables(tmp_path / "none").names() == []
