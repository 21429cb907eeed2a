"""The pitot watch on recorded flights, as they are and with the second pitot taken away."""

from pathlib import Path

import numpy as np
import pytest

from links.logs import open_log
from links.samples import Batch
from links.vocabulary import Kind, State
from monitor.pipeline import Pipeline
from monitor.settings import Settings
from monitor.verdict import Verdict
from monitor.watch.air_bank import AirBankWatch

HEALTHY = ["n1_calm_nominal", "nominal", "h4_healthy_windy", "n2_windy_nominal"]
IMU_FAULTS = ["f5_gyro_bias", "f6_accel_bias", "h1_accz5"]
ALFA = "carbonZ_2018-07-30-"
ALFA_HEALTHY = [ALFA + "16-39-00_3_no_failure", ALFA + "17-36-35_engine_failure_with_emr_traj"]


def faults(data: Path, name: str, *, pitots: int = 2) -> dict[str, Verdict]:
    """First verdict of faulty per pitot, from the flight's log with one or two pitots."""
    path = next(data.glob(f"*/{name}.tlog"))
    pipeline = Pipeline(Settings(), watches=[AirBankWatch(Settings().air)])
    verdicts: list[Verdict] = []
    for batch in open_log(path):
        kept = {s: r for s, r in batch.rows.items() if pitots == 2 or s != "airspeed1"}
        verdicts += pipeline.feed(Batch(kept)).verdicts
    verdicts += pipeline.finish().verdicts
    out: dict[str, Verdict] = {}
    for v in verdicts:
        if v.state is State.FAULTY:
            assert v.sensor.startswith("airspeed")
            out.setdefault(v.sensor, v)
    return out


def seconds(v: Verdict) -> float:
    return v.t_us * 1e-6


@pytest.mark.parametrize("pitots", [1, 2])
@pytest.mark.parametrize("name", [*HEALTHY, *IMU_FAULTS, "f7_gps_faults"])
def test_no_pitot_is_blamed_where_none_is_broken(shared_data: Path, name: str, pitots: int) -> None:
    assert faults(shared_data, name, pitots=pitots) == {}


@pytest.mark.parametrize("name", ALFA_HEALTHY)
def test_real_flights_with_a_healthy_pitot(shared_data: Path, name: str) -> None:
    assert faults(shared_data, name) == {}


def test_the_real_dead_pitot_is_found_at_once(shared_data: Path) -> None:
    found = faults(shared_data, "carbonZ_2018-09-11-14-41-51_elevator_failure")
    v = found["airspeed0"]
    assert v.kind in (Kind.STUCK, Kind.DROPOUT)
    first_row_s = 498.766
    assert seconds(v) - first_row_s < 10.0


@pytest.mark.parametrize(
    ("name", "pitots", "start_s", "within_s"),
    [
        ("f2_pitot_block_pressure", 2, 139.0, 2.5),
        ("f2_pitot_block_pressure", 1, 139.0, 2.5),
        ("f3_arspd_scale", 2, 139.0, 5.0),
        ("f3_arspd_scale", 1, 139.0, 45.0),
        ("h2_ramp60", 2, 149.0, 10.0),
        ("h5_pitot_autotest", 2, 149.0, 2.5),
        ("h5_pitot_autotest", 1, 149.0, 2.5),
        ("f9_noise_and_gust", 2, 129.0, 3.0),
    ],
)
def test_the_broken_first_pitot_is_found_and_it_alone(
    shared_data: Path, name: str, pitots: int, start_s: float, within_s: float
) -> None:
    found = faults(shared_data, name, pitots=pitots)
    assert set(found) == {"airspeed0"}
    assert start_s - 0.5 < seconds(found["airspeed0"]) < start_s + within_s


def test_both_iced_pitots_are_blamed_together(shared_data: Path) -> None:
    found = faults(shared_data, "h7_icing_both")
    assert set(found) == {"airspeed0", "airspeed1"}
    times = np.array([seconds(v) for v in found.values()])
    assert np.ptp(times) < 1.0
    assert (times < 186.0).all()
