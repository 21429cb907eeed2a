"""The published wind and airspeed against the simulator that flew the recorded flights.

Truth is the mean wind that the simulator was told, SIM_WIND_SPD from SIM_WIND_DIR, and the true
airspeed of the SIM2 records that one flight's on-board log holds; no estimator reads either.
"""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from pymavlink import DFReader

from links.logs import open_log
from links.samples import Batch, Rows
from monitor.pipeline import Pipeline
from monitor.settings import Settings
from monitor.watch.air_bank import AirBankWatch

HEALTHY = ["n1_calm_nominal", "nominal", "h4_healthy_windy", "n2_windy_nominal"]
UNTIL_S = {"f5_gyro_bias": 320.0, "h1_accz5": 320.0, "f6_accel_bias": 139.0}
"""Flights with a broken IMU. In f6 it takes the attitude along, and nobody else knows the wind."""
LIMIT_M_S = {"n2_windy_nominal": 0.6}
"""Turbulence 4 there, 0 to 2 elsewhere."""
SETTLED_S = 60.0


def estimates(data: Path, name: str, pitots: int) -> Rows:
    """Air estimates from a minute after take-off, with one or two pitots."""
    pipeline = Pipeline(Settings(), watches=[AirBankWatch(Settings().air)])
    out = []
    for batch in open_log(data / "sitl" / f"{name}.tlog"):
        kept = {s: r for s, r in batch.rows.items() if pitots == 2 or s != "airspeed1"}
        out.append(pipeline.feed(Batch(kept)))
    out.append(pipeline.finish())
    rows = np.concatenate([r.estimates["air"] for r in out if "air" in r.estimates])
    return rows[rows["t_us"] > rows["t_us"][0] + SETTLED_S * 1e6]


def mean_wind(data: Path, name: str) -> np.ndarray:
    """What the simulator was told, as the velocity toward which the air moves, NED [m/s]."""
    said = json.loads((data / "sitl" / f"{name}.json").read_text())["parameters"]
    toward = math.radians(said["SIM_WIND_DIR"] + 180.0)
    return said["SIM_WIND_SPD"] * np.array([math.cos(toward), math.sin(toward), 0.0])


def rms(x: np.ndarray) -> float:
    return math.sqrt(float(np.mean(x * x)))


@pytest.mark.parametrize("pitots", [1, 2])
@pytest.mark.parametrize("name", [*HEALTHY, *UNTIL_S])
def test_the_wind_is_the_simulators(shared_data: Path, name: str, pitots: int) -> None:
    rows = estimates(shared_data, name, pitots)
    rows = rows[rows["t_us"] * 1e-6 < UNTIL_S.get(name, math.inf)]
    error = rows["wind_ned_m_s"] - mean_wind(shared_data, name)
    limit = LIMIT_M_S.get(name, 0.3)
    assert len(rows) > 100
    assert rms(error[:, 0]) < limit
    assert rms(error[:, 1]) < limit
    for axis in range(2):
        inside = np.abs(error[:, axis]) < 2.0 * rows["wind_std_ned_m_s"][:, axis]
        assert inside.mean() > 0.85


@pytest.mark.parametrize("pitots", [1, 2])
def test_airspeeds_are_those_of_the_simulator(shared_data: Path, pitots: int) -> None:
    rows = estimates(shared_data, "f6_accel_bias", pitots)
    t_us, eas = simulated_eas(shared_data / "sitl" / "f6_accel_bias.BIN")
    true = np.interp(rows["t_us"], t_us, eas)
    error = rows["cas_m_s"] - true
    assert rms(error) < 0.8
    assert abs(error.mean()) < 0.3
    assert (np.abs(error) < 2.0 * rows["cas_std_m_s"]).mean() > 0.85


def simulated_eas(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Times [us] and equivalent airspeeds [m/s] of an on-board log's SIM2 records, means of 1 s.

    The simulator's turbulence jumps at every sample; a second is what a pitot's message and a GPS
    epoch can share of it.
    """
    log = DFReader.DFReader_binary(str(path))
    found = []
    while (m := log.recv_match(type="SIM2")) is not None:
        found.append((m.TimeUS, m.As))
    log.filehandle.close()
    t_us, eas = np.array(found).T
    return t_us, np.convolve(eas, np.ones(50) / 50, "same")
