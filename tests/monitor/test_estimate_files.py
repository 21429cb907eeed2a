"""Estimates on disk: whole or not at all, units in the names, the same numbers in both formats."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from monitor import csv_file
from monitor.columns import flat, unit_of
from monitor.estimate_files import EstimateFiles
from monitor.verdict import AIR_ESTIMATE, ENGINE_ESTIMATE, IMU_ESTIMATE, WING_ESTIMATE

ABOUT = {"mavsentry.version": "1", "mavsentry.configuration": "{}"}


def air(n: int, first: int = 0) -> np.ndarray:
    rows = np.zeros(n, AIR_ESTIMATE)
    rows["t_us"] = np.arange(first, first + n)
    rows["cas_m_s"] = np.random.default_rng(first).normal(20.0, 1.0, n)
    rows["aoa_rad"] = np.nan
    rows["wind_ned_m_s"] = [1.0, 2.0, 3.0]
    return rows


def names(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir())


@pytest.mark.parametrize("dtype", [AIR_ESTIMATE, IMU_ESTIMATE, ENGINE_ESTIMATE, WING_ESTIMATE])
def test_every_column_has_its_unit_in_its_name(dtype: np.dtype) -> None:
    without = {c for c in flat(np.zeros(1, dtype)) if unit_of(c) == "1"}
    assert without <= {"throttle"}


def test_vectors_become_a_column_per_axis_with_the_unit_at_the_end() -> None:
    columns = flat(air(1))
    assert [columns[f"wind_{a}_m_s"][0] for a in ("north", "east", "down")] == [1.0, 2.0, 3.0]
    assert unit_of("wind_north_std_m_s") == "m/s"
    assert unit_of("acc_x_fault_std_m_s2") == "m/s^2"
    assert unit_of("gyro_x_rad_s") == "rad/s"


def test_rows_come_back_as_they_were_whatever_the_size_of_a_row_group(tmp_path: Path) -> None:
    pq = pytest.importorskip("pyarrow.parquet")
    for at_once in (1, 7, 1000):
        folder = tmp_path / str(at_once)
        with EstimateFiles(folder, ABOUT, csv=True, rows_at_once=at_once) as files:
            for k in range(5):
                files.add({"air": air(5, 5 * k), "imu0": np.zeros(k, IMU_ESTIMATE)})
            written = files.finish({"mavsentry.first_t_us": "7"})
        assert names(folder) == [p.name for p in written]
        want = flat(np.concatenate([air(5, 5 * k) for k in range(5)]))
        table = pq.read_table(folder / "air.parquet")
        assert table.column_names == list(want)
        with open(folder / "air.csv", newline="") as file:
            lines = list(csv.DictReader(file))
        for name, values in want.items():
            np.testing.assert_array_equal(table[name].to_numpy(), values)
            read = [float(line[name]) if line[name] else np.nan for line in lines]
            np.testing.assert_array_equal(read, values)
        assert pq.ParquetFile(folder / "imu0.parquet").metadata.num_rows == 10


def test_a_parquet_file_says_what_made_it_and_the_unit_of_each_column(tmp_path: Path) -> None:
    pq = pytest.importorskip("pyarrow.parquet")
    with EstimateFiles(tmp_path, ABOUT) as files:
        files.add({"air": air(3)})
        (file,) = files.finish({"mavsentry.first_t_us": "7"})
    schema = pq.read_schema(file)
    assert schema.metadata[b"mavsentry.version"] == b"1"
    assert schema.metadata[b"mavsentry.estimate"] == b"air"
    assert schema.field("cas_m_s").metadata[b"unit"] == b"m/s"
    assert pq.read_metadata(file).metadata[b"mavsentry.first_t_us"] == b"7"


def test_nothing_unfinished_stays_and_an_earlier_analysis_is_replaced_only_by_a_whole_one(
    tmp_path: Path,
) -> None:
    with EstimateFiles(tmp_path, ABOUT, csv=True) as files:
        files.add({"air": air(3), "wing": np.zeros(2, WING_ESTIMATE)})
        files.finish({})
    before = {p: p.read_bytes() for p in tmp_path.iterdir()}
    with EstimateFiles(tmp_path, ABOUT, csv=True, rows_at_once=1) as files:
        files.add({"air": air(9)})
        assert set(names(tmp_path)) - {p.name for p in before} == {
            f"air{suffix}.unfinished" for suffix in (".parquet", ".csv")
        }
    assert {p: p.read_bytes() for p in tmp_path.iterdir()} == before
    (tmp_path / "notes.txt").write_text("mine")
    with EstimateFiles(tmp_path, ABOUT, csv=True) as files:
        files.add({"imu0": np.zeros(1, IMU_ESTIMATE)})
        written = files.finish({})
    assert names(tmp_path) == sorted([*(p.name for p in written), "notes.txt"])


def test_ctrl_c_while_a_file_is_opened_leaves_nothing(tmp_path: Path, monkeypatch) -> None:
    opened = csv_file.CsvFile.__init__

    def interrupted(self, path, first):
        opened(self, path, first)
        self._file.close()
        raise KeyboardInterrupt

    monkeypatch.setattr(csv_file.CsvFile, "__init__", interrupted)
    with EstimateFiles(tmp_path, ABOUT, csv=True, rows_at_once=1) as files:
        with pytest.raises(KeyboardInterrupt):
            files.add({"air": air(1)})
        assert "air.csv.unfinished" in names(tmp_path)
    assert names(tmp_path) == []


def test_a_log_that_is_refused_leaves_no_folder(tmp_path: Path) -> None:
    with EstimateFiles(tmp_path / "none", ABOUT):
        pass
    assert not (tmp_path / "none").exists()


def test_a_folder_that_cannot_be_made_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with EstimateFiles(tmp_path / "file" / "estimates", ABOUT, csv=True) as files:
        files.add({"air": air(1)})
        with pytest.raises(OSError):
            files.finish({})
