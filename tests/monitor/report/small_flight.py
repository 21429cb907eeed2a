"""Flights made of a few rows, for panels that want one thing shown."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from links.samples import Rows
from monitor.report.flight import Flight
from monitor.report.tables import MemoryTables
from monitor.settings import Settings, load
from monitor.verdict import AIR_ESTIMATE, IMU_ESTIMATE, WING_ESTIMATE, Verdict
from tests.monitor.report.summaries import summary

Floats = NDArray[np.float64]

T_S = np.arange(0.0, 300.0, 0.5)
"""Moments of every table [s]."""


def rows(dtype: np.dtype[Any], **columns: Floats | float) -> Rows:
    """Rows at :data:`T_S`; columns that are not given are NaN."""
    out = np.zeros(T_S.size, dtype)
    for name in dtype.names or ():
        if name != "t_us":
            out[name] = np.nan
    out["t_us"] = np.round(T_S * 1e6)
    for name, values in columns.items():
        out[name] = values
    return out


def measured(name: str, unit: str, low: Floats | float, high: Floats | float | None = None) -> Rows:
    """A trace as :mod:`monitor.traces` leaves it."""
    fields = [("t_us", "<i8"), (f"{name}_low_{unit}", "<f8"), (f"{name}_high_{unit}", "<f8")]
    return rows(
        np.dtype(fields),
        **{f"{name}_low_{unit}": low, f"{name}_high_{unit}": low if high is None else high},
    )


def air(cas_m_s: Floats | float = 20.0, std_m_s: float = 0.5, **columns: Any) -> Rows:
    """Airspeed with its deviation; angles and wind where they are given."""
    return rows(AIR_ESTIMATE, cas_m_s=cas_m_s, cas_std_m_s=std_m_s, tas_m_s=cas_m_s, **columns)


def imu(**columns: Any) -> Rows:
    """Errors of an IMU, zero with deviations of 0.05 unless given."""
    usual = {
        name: np.full((T_S.size, 3), value)
        for name, value in (
            ("acc_fault_m_s2", 0.0),
            ("acc_fault_std_m_s2", 0.05),
            ("gyro_fault_rad_s", 0.0),
            ("gyro_fault_std_rad_s", 0.002),
        )
    }
    return rows(IMU_ESTIMATE, **(usual | columns))


def wing(**columns: Any) -> Rows:
    """Wings of which nothing was lost unless given."""
    usual = {
        name: 20.0 if "std" in name else 0.0 for name in WING_ESTIMATE.names or () if name != "t_us"
    }
    return rows(WING_ESTIMATE, **(usual | columns))


def flight(
    tables: Mapping[str, Rows] | None = None,
    *,
    settings: Settings | None = None,
    verdicts: tuple[Verdict, ...] = (),
    **changed: Any,
) -> Flight:
    """A flight of 300 s with these tables and this summary."""
    return Flight(summary(**changed), settings or load(), verdicts, MemoryTables(tables or {}))
