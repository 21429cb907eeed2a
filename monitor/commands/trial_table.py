"""Injected against found: which fault, when, how large, and what the true value was."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from links.samples import Rows
from links.vocabulary import GYRO_ACC_AXES

if TYPE_CHECKING:
    from rich.table import Table

    from monitor.commands.trial import Trial

__all__ = ["Outcome", "judge", "outcome_table"]

EARLY_S, LATE_S = 0.5, 15.0
"""A verdict belongs to a fault from this long before its onset to this long after its end."""

COMPARED_AFTER_S = 4.0
"""True and reconstructed values are compared this long after detection, or at the fault's end."""

_SHOWN = {"rad": (degrees(1.0), "deg"), "rad/s": (degrees(1.0), "deg/s")}


@dataclass(frozen=True, slots=True)
class Outcome:
    """Faults that were injected with what was found of each, and verdicts that nothing explains.

    Attributes
    ----------
    rows
        (injected fault of ``truth.json``, fault of ``summary.json`` or None).
    false
        Faults of ``summary.json`` that fit no injected one.
    values
        Per row: true and reconstructed value of what the sensor measures, and their unit.
    sizes
        Per row: the injected error at detection in the fault's unit, NaN if it is not a number.
    """

    rows: list[tuple[dict[str, Any], dict[str, Any] | None]]
    false: list[dict[str, Any]]
    values: list[tuple[float, float, str]]
    sizes: list[float]

    @property
    def good(self) -> bool:
        """Everything found, nothing else raised."""
        return not self.false and all(found for _, found in self.rows)


def judge(trial: Trial, truth_arrays: Path) -> Outcome:
    """Match what was found with what was injected.

    Parameters
    ----------
    trial
        What the daemon and the analysis of its recording said.
    truth_arrays
        ``truth.npz`` of the feed.
    """
    left = list(trial.analysis.faults)
    rows: list[tuple[dict[str, Any], dict[str, Any] | None]] = []
    for injected in sorted(trial.truth["faults"], key=lambda f: float(f["onset_s"])):
        fits = [f for f in left if _fits(f, injected)]
        found = min(fits, key=lambda f: int(f["detected_t_us"])) if fits else None
        left = [f for f in left if f not in fits]
        rows.append((injected, found))
    with np.load(truth_arrays) as arrays:
        truth = {name: arrays[name] for name in arrays.files}
    estimates = trial.estimates
    values = [_values(injected, found, truth, estimates) for injected, found in rows]
    sizes = [_size(injected, found, truth) for injected, found in rows]
    return Outcome(rows, left, values, sizes)


def outcome_table(outcome: Outcome) -> Table:
    """Injected against found, one line per fault."""
    from rich.table import Table

    table = Table(title="injected / found", title_justify="left")
    table.add_column("sensor", no_wrap=True)
    table.add_column("kind", no_wrap=True)
    for column in ("onset", "found after", "error", "true value", "reconstructed"):
        table.add_column(column, justify="right", no_wrap=True)
    for (injected, found), value, size in zip(
        outcome.rows, outcome.values, outcome.sizes, strict=True
    ):
        true, reconstructed, unit = value
        if found is None:
            onset = f"{injected['onset_s']:.1f} s / -"
            table.add_row(injected["sensor"], injected["kind"], onset, "[bold red]MISSED")
            continue
        factor, shown = _SHOWN.get(found["unit"], (1.0, found["unit"]))
        magnitude = np.nan if found["magnitude"] is None else found["magnitude"]
        table.add_row(
            injected["sensor"],
            f"{injected['kind']} / {found['kind']}",
            f"{injected['onset_s']:.1f} / {found['onset_s']:.1f} s",
            f"{found['detected_s'] - injected['onset_s']:.1f} s",
            f"{_number(size * factor)} / {_number(magnitude * factor)} {shown}",
            f"{_number(true, sign=False)} {unit}",
            f"{_number(reconstructed, sign=False)} {unit}",
        )
    return table


def _fits(found: Mapping[str, Any], injected: Mapping[str, Any]) -> bool:
    if found["sensor"] != injected["sensor"]:
        return False
    end_s = injected["end_s"]
    latest_s = np.inf if end_s is None else end_s + LATE_S
    return bool(injected["onset_s"] - EARLY_S <= found["detected_s"] <= latest_s)


def _true_series(sensor: str, truth: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    """What a perfect sensor of this name would have read, SI."""
    group, _, axis = sensor.partition(".")
    if axis in GYRO_ACC_AXES:
        place = GYRO_ACC_AXES.index(axis)
        name = "specific_force_m_s2" if place < 3 else "rate_rad_s"
        return truth[name][:, place % 3]
    return truth["cas_m_s" if group.startswith("airspeed") else "aoa_rad"]


def _reconstructed(sensor: str, estimates: Mapping[str, Rows], t_us: float) -> float:
    """The monitor's value of the same at this vehicle time, SI; NaN if it has none."""
    group, _, axis = sensor.partition(".")
    rows = estimates.get(group if axis else "air")
    if rows is None or not len(rows):
        return float("nan")
    row = rows[np.argmin(np.abs(rows["t_us"] - t_us))]
    if axis in GYRO_ACC_AXES:
        place = GYRO_ACC_AXES.index(axis)
        return float(row["acc_m_s2" if place < 3 else "gyro_rad_s"][place % 3])
    return float(row["cas_m_s" if group.startswith("airspeed") else "aoa_rad"])


def _unit(sensor: str) -> str:
    group, _, axis = sensor.partition(".")
    if axis:
        return "m/s^2" if axis.startswith("acc") else "rad/s"
    return "m/s" if group.startswith("airspeed") else "rad"


def _values(
    injected: Mapping[str, Any],
    found: Mapping[str, Any] | None,
    truth: Mapping[str, NDArray[np.float64]],
    estimates: Mapping[str, Rows],
) -> tuple[float, float, str]:
    """True and reconstructed value a while after detection, in a pilot's unit."""
    sensor = str(injected["sensor"])
    factor, unit = _SHOWN.get(_unit(sensor), (1.0, _unit(sensor)))
    if found is None:
        return float("nan"), float("nan"), unit
    t_us = found["detected_t_us"] + COMPARED_AFTER_S * 1e6
    if injected["end_t_us"] is not None:
        t_us = min(t_us, injected["end_t_us"])
    group, _, axis = sensor.partition(".")
    rows = estimates.get(group if axis else "air")
    if rows is not None and len(rows):  # at the very time of an estimate, not near it
        t_us = float(rows["t_us"][np.argmin(np.abs(rows["t_us"] - t_us))])
    true = float(np.interp(t_us, truth["t_us"], _true_series(sensor, truth)))
    return true * factor, _reconstructed(sensor, estimates, t_us) * factor, unit


def _size(
    injected: Mapping[str, Any],
    found: Mapping[str, Any] | None,
    truth: Mapping[str, NDArray[np.float64]],
) -> float:
    """Error of the broken sensor at detection, SI; NaN where the fault model gives no number."""
    if found is None:
        return float("nan")
    after_s = max(0.0, (found["detected_t_us"] - injected["onset_t_us"]) / 1e6)
    limit = injected["limit"] or float("inf")
    match injected["model"]:
        case "bias":
            return float(injected["size"])
        case "drift" | "runaway":
            return float(np.clip(injected["rate_per_s"] * after_s, -limit, limit))
        case "stuck" | "scale":
            true = _true_series(str(injected["sensor"]), truth)
            then, now = np.interp(
                (injected["onset_t_us"], found["detected_t_us"]), truth["t_us"], true
            )
            return float(then - now if injected["model"] == "stuck" else injected["size"] * now)
        case _:
            return float("nan")


def _number(value: float, sign: bool = True) -> str:
    if not np.isfinite(value):
        return "-"
    digits = 2 if abs(value) < 10 else 1
    return f"{value:+.{digits}f}" if sign else f"{value:.{digits}f}"
