"""The IMU watch on recorded flights, as they are and with the second IMU taken away."""

from __future__ import annotations

from pathlib import Path

import pytest

from links.logs import open_log
from links.samples import Batch
from links.vocabulary import State
from monitor.pipeline import Pipeline
from monitor.settings import Settings
from monitor.verdict import Verdict
from monitor.watch.imu import ImuWatch

HEALTHY = ["n1_calm_nominal", "nominal", "n2_windy_nominal", "f7_gps_faults", "f9_noise_and_gust"]
ALFA = [
    "carbonZ_2018-07-30-16-39-00_3_no_failure",
    "carbonZ_2018-07-30-17-36-35_engine_failure_with_emr_traj",
    "carbonZ_2018-09-11-14-41-51_elevator_failure",
]
FOUND = {
    "f5_gyro_bias": {"imu0.gyro_x": (138.9, 6.0), "imu0.gyro_z": (228.9, 12.0)},
    "f6_accel_bias": {"imu0.acc_x": (139.0, 5.0), "imu0.acc_z": (229.0, 8.0)},
    "h1_accz5": {"imu0.acc_z": (149.0, 5.0)},
}
"""Flight -> axis -> start of the fault [s], seconds within which it is found."""
ENDS = {"imu0.gyro_x": 198.9, "imu0.acc_x": 199.0, "imu0.acc_z": 209.0}


def judged(data: Path, name: str, *, imus: int) -> list[Verdict]:
    """All verdicts of the watch over a log, with one or two of its IMUs."""
    pipeline = Pipeline(Settings(), watches=[ImuWatch(Settings().imu)])
    verdicts: list[Verdict] = []
    for batch in open_log(next(data.glob(f"*/{name}.tlog"))):
        kept = {s: r for s, r in batch.rows.items() if imus == 2 or s not in ("imu1", "imu2")}
        verdicts += pipeline.feed(Batch(kept)).verdicts
    return verdicts + pipeline.finish().verdicts


@pytest.mark.parametrize("imus", [1, 2])
@pytest.mark.parametrize("name", [*HEALTHY, *ALFA])
def test_no_imu_is_blamed_where_none_is_broken(shared_data: Path, name: str, imus: int) -> None:
    verdicts = judged(shared_data, name, imus=imus)
    assert [v for v in verdicts if v.state in (State.FAULTY, State.SUSPECT)] == []
    assert {v.sensor for v in verdicts if v.state is State.OK} >= {"imu0.acc_x", "imu0.gyro_z"}


@pytest.mark.parametrize("imus", [1, 2])
@pytest.mark.parametrize("name", FOUND)
def test_the_broken_axis_is_found_and_nothing_else(shared_data: Path, name: str, imus: int) -> None:
    verdicts = judged(shared_data, name, imus=imus)
    faults = [v for v in verdicts if v.state is State.FAULTY]
    assert [v.sensor for v in faults] == list(FOUND[name])
    for v in faults:
        start_s, limit_s = FOUND[name][v.sensor]
        assert start_s < v.t_us * 1e-6 < start_s + limit_s
        assert v.evidence.startswith(("GPS velocity and static pressure", "GPS velocity, static"))
        if imus == 2:
            assert (v.detected_t_us or v.t_us) * 1e-6 < start_s + 1.1
            assert "agree with imu1 and not with imu0" in v.evidence


@pytest.mark.parametrize("name", FOUND)
def test_the_axis_is_re_admitted_within_twenty_seconds(shared_data: Path, name: str) -> None:
    verdicts = judged(shared_data, name, imus=2)
    axis = next(iter(FOUND[name]))
    back = [v for v in verdicts if v.sensor == axis and v.t_us > 198e6 and v.state is State.OK]
    assert ENDS[axis] < back[0].t_us * 1e-6 < ENDS[axis] + 20.0
