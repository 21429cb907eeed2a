"""The scenarios of wan2016 given to the watch that flies: :mod:`monitor.watch.air_triplex`.

It knows three dimensions, learns offsets, decides ten times a second and names each sensor by a
verdict. It gets the readings of the experiment as rows, with GPS and attitude at the same rate.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from links.samples import Rows, empty_rows
from links.vocabulary import State
from monitor.settings import load
from monitor.verdict import PHASE_ROW
from monitor.watch.air_triplex import AirTriplexWatch
from sim_feeds.papers.wan import LongitudinalExperiment

__all__ = ["DeployedRecord", "run_deployed"]

Floats = NDArray[np.float64]

PROFILE: Final = "transport"
GPS_STD_M_S: Final = 0.1
NOISE_STREAM: Final = 5
"""Child of the seed that the GPS noise is drawn from; the experiment uses others."""
SENSORS: Final = (*(f"aoa{i}" for i in range(3)), *(f"airspeed{i}" for i in range(3)))


@dataclass(frozen=True)
class DeployedRecord:
    """What the watch said, at the samples of the experiment.

    Attributes
    ----------
    alpha, cas : (T,) float64 [rad, m/s]
        Its estimates; NaN before the first.
    faulty : (T, 2, 3) bool
        Vanes, then pitots.
    """

    alpha: Floats
    cas: Floats
    faulty: NDArray[np.bool_]


def run_deployed(flight: LongitudinalExperiment, seed: int) -> DeployedRecord:
    """The watch over one flight, in flight from its first row."""
    watch = AirTriplexWatch(load(PROFILE).triplex)
    result = watch.step(_rows(flight, seed), int(flight.t_s[-1] * 1e6) + 1)
    t_us = flight.t_s * 1e6
    faulty = np.zeros((len(t_us), 6), dtype=bool)
    for verdict in result.verdicts:
        if verdict.sensor in SENSORS:
            on = t_us >= verdict.t_us
            faulty[on, SENSORS.index(verdict.sensor)] = verdict.state is State.FAULTY
    air = result.estimates["air"]
    alpha, cas = (
        np.interp(t_us, air["t_us"], air[name], left=np.nan) for name in ("aoa_rad", "cas_m_s")
    )
    return DeployedRecord(alpha, cas, faulty.reshape(-1, 2, 3))


def _rows(flight: LongitudinalExperiment, seed: int) -> dict[str, Rows]:
    """The experiment's readings as the rows of a vehicle."""
    truth, n = flight.truth, len(flight.t_s)
    rng = np.random.default_rng([seed, NOISE_STREAM])
    velocity = truth.vel_ned_m_s + GPS_STD_M_S * rng.standard_normal((n, 3))
    columns: dict[str, dict[str, Floats | int]] = {
        "attitude": {"q_ned_from_frd": truth.q_ned_from_frd, "rate_rad_s": truth.rate_rad_s},
        "gps0": {"vel_ned_m_s": velocity, "fix_type": 3},
        "nav": {"vel_ned_m_s": velocity},
        "imu0": {"acc_m_s2": truth.specific_force_m_s2, "gyro_rad_s": truth.rate_rad_s},
        "baro0": {"static_press_pa": truth.static_pa, "temperature_k": truth.temperature_k},
    }
    for i in range(3):
        columns[f"aoa{i}"] = {"aoa_rad": flight.aoa_rad[:, i]}
        columns[f"airspeed{i}"] = {"cas_m_s": flight.cas_m_s[:, i]}
    out: dict[str, Rows] = {"phase": np.array([(0, 0, True)], PHASE_ROW)}
    for number, (sensor, values) in enumerate(columns.items()):
        rows = empty_rows(sensor, n)
        rows["t_us"] = np.round(flight.t_s * 1e6).astype(np.int64)
        rows["seq"] = 1 + number + len(columns) * np.arange(n)
        for name, value in values.items():
            rows[name] = value
        out[sensor] = rows
    # what the experiment measures with noise takes the place of the truth
    out["imu0"]["acc_m_s2"][:, [0, 2]] = flight.theta[:, 3:5]
    for sensor, name in (("imu0", "gyro_rad_s"), ("attitude", "rate_rad_s")):
        out[sensor][name][:, 1] = flight.theta[:, 2]
    return out
