"""A finding in words: its heading, its size, and what its test statistic is a measure of."""

from __future__ import annotations

import math
from typing import Final

from links.vocabulary import Kind
from monitor.pages.html import clock
from monitor.pages.units import on_screen
from monitor.report.evidence_cases import APART_S, Case, Group
from monitor.report.evidence_data import Family, Subject
from monitor.report.wording import lasting
from monitor.settings import Settings

__all__ = [
    "estimator_words",
    "group_heading",
    "heading",
    "size_words",
    "statistic_words",
]

_SHAPES: Final = {
    Kind.DRIFT: "drifting to {size} {side}",
    Kind.RUNAWAY: "running away to {size} {side}",
    Kind.OSCILLATION: "swinging",
    Kind.NOISE: "noisy",
    Kind.STUCK: "stuck",
    Kind.DROPOUT: "dead",
}
_DECIDED: Final = {
    "air_data_3d": "filter bank: explanations of GPS, attitude and pitots compete",
    "air_horizon": "constrained horizon of minutes, for slow faults",
    "air_checks": "check of single samples",
    "air_vote": "vote among the sensors of its kind",
    "air_mhe_3d": "moving horizon with a bounded wind",
    "air_vane": "vane against attitude, ground speed and wind",
    "ins_bank": "inertial filters against GPS and static pressure",
    "imu_difference": "the samples themselves",
    "engine_judge": "engine-speed channels, throttle and energy of the aircraft",
    "wing_stream": "accelerations against the airframe's coefficients",
}


def size_words(size: float | None, unit: str) -> str:
    """A size without its sign: ``size_words(-0.0785, "rad/s") == "4.5 °/s"``."""
    if size is None or not math.isfinite(size):
        return "unknown"
    factor, shown = on_screen(unit)
    value = abs(size) * factor
    decimals = 0 if value >= 99.5 else 1 if value >= 0.995 else 2
    space = "" if shown == "°" else " "
    return f"{value:.{decimals}f}{space}{shown}"


def heading(case: Case, subject: Subject | None) -> str:
    """``airspeed0 faulty: 4.7 m/s low from 1:34, found 1.8 s later, cleared 2:10``."""
    state = "stopped" if case.is_event else "faulty"
    what = "" if case.is_event else f" {_what(case, subject)}"
    noticed, named = case.detected_s - case.onset_s, case.isolated_s - case.onset_s
    found = f"found {lasting(noticed)} later"
    if named - noticed > APART_S:
        found = f"noticed {lasting(noticed)} later, named after {lasting(named)}"
    end = "to the end of the log" if case.cleared_s is None else f"cleared {clock(case.cleared_s)}"
    return f"{case.sensor} {state}:{what} from {clock(case.onset_s)}, {found}, {end}"


def group_heading(group: Group, subject: Subject | None) -> str:
    """Heading of findings that share a section."""
    first = group.cases[0]
    if len(group.cases) == 1:
        return heading(first, subject)
    if len(group.sensors) > 1:
        imu = first.sensor.partition(".")[0]
        axes = "all axes" if len(group.sensors) == 6 else f"{len(group.sensors)} axes"
        return heading(first, subject).replace(first.sensor, f"{imu} ({axes})", 1)
    return (
        f"{first.sensor} faulty {len(group.cases)} times between {clock(first.onset_s)} and "
        f"{clock(group.cases[-1].isolated_s)}"
    )


def _what(case: Case, subject: Subject | None) -> str:
    size, unit = case.found.get("magnitude"), str(case.found.get("unit", ""))
    if case.kind is Kind.NOISE and subject is not None and subject.family in _INERTIAL and size:
        return f"noise of {size_words(size, unit)} rms"
    if subject is not None and subject.family is Family.WING and size is not None:
        changed = "less lift" if case.sensor.endswith("lift") else "more drag"
        return f"{size_words(size, unit)} {changed} than the other wing"
    shape = _SHAPES.get(case.kind, "{size} {side}")
    if size is None:
        return shape.partition(" to ")[0] if case.kind in _SHAPES else "of unknown size"
    return shape.format(size=size_words(size, unit), side="high" if size > 0 else "low")


_INERTIAL: Final = (Family.ACC, Family.GYRO)


def estimator_words(case: Case) -> str:
    """Which part decided, and what it does."""
    name = str(case.found.get("estimator", "")).rpartition(".")[2]
    said = _DECIDED.get(name)
    return f"{name} ({said})" if said else name or "not recorded"


def statistic_words(case: Case, settings: Settings) -> str:
    """``62.7 against a threshold of 8 (log odds ...)``: the number that decided, and what it is."""
    statistic, threshold = case.found.get("statistic"), case.found.get("threshold")
    if statistic is None or threshold is None:
        return "none: see the evidence"
    unit, meaning = _measure(case, settings)
    factor, shown = on_screen(unit)
    space = "" if shown in ("", "°") else " "
    return (
        f"{statistic * factor:.3g}{space}{shown} against a threshold of "
        f"{threshold * factor:.3g}{space}{shown} ({meaning})"
    )


def _measure(case: Case, settings: Settings) -> tuple[str, str]:
    """Unit and meaning of a statistic, from who decided and the shape that was found."""
    estimator = str(case.found.get("estimator", "")).rpartition(".")[2]
    threshold = float(case.found["threshold"])
    scatter = case.kind in (Kind.NOISE, Kind.OSCILLATION)
    still = {"imu_difference": False, "engine_judge": threshold == settings.engine.stuck_s}
    if case.kind is Kind.STUCK and still.get(estimator, True):
        return "s", "time without a change"
    match estimator:
        case "air_data_3d" | "air_horizon":
            return "1", "log odds that it shifted, over every other explanation"
        case "air_checks" if scatter:
            return "1", "scatter against the other pitots, share of the airspeed"
        case "air_checks" if threshold == settings.air.gross_ln:
            return "1", "logarithm of reading over expectation"
        case "air_checks":
            return "m/s", "wind that it would take to explain the reading"
        case "air_vane" if scatter:
            return "rad", "rms scatter about its mean"
        case "air_vane" if threshold == math.radians(settings.vane.gross_deg):
            return "rad", "difference from what attitude, ground speed and wind say"
        case "air_vane":
            return "1", "log odds that it shifted, over a vertical wind"
        case "air_vote":
            return str(case.found["unit"]), "mean or rms difference over a second"
        case "air_mhe_3d":
            return str(case.found["unit"]), "difference from the bounded estimate"
        case "ins_bank" if case.kind is Kind.OSCILLATION and threshold not in _nats(settings):
            return "1", "energy of the swings against the attitude, in variances"
        case "ins_bank" if threshold in _nats(settings):
            return "1", "log odds that this IMU is the one that is wrong"
        case "ins_bank":
            return "σ", "standard deviations of the difference or step"
        case "imu_difference" if case.kind is Kind.DROPOUT:
            return "s", "time at exactly zero"
        case "imu_difference" if case.kind is Kind.STUCK:
            return "1", "improbability of so long a standstill"
        case "imu_difference":
            return "1", "logarithm of its noise over what its peers say is usual"
        case "wing_stream":
            return "%", "what this wing changed more than the other one"
        case "engine_judge" if threshold in (settings.engine.cut_s, settings.engine.no_power_s):
            return "s", "time without power"
        case "engine_judge" if threshold == settings.engine.wrong_share:
            return "1", "share of wrong readings"
        case "engine_judge":
            return "1", "log odds: engine stopped against channels failed"
    return "1", "see the evidence"


def _nats(settings: Settings) -> tuple[float, float]:
    """Odds that settle whose a difference is; about the vertical axis twice as much is asked."""
    return settings.imu.arbitration_nats, 2.0 * settings.imu.arbitration_nats
