"""What is drawn as evidence of a verdict: one table of sensors, and the sizes they are held to.

:func:`subject_of` maps a watched sensor to what was measured of it, what it should have shown, how
large its error was, and whom to compare it with; :func:`limit_of` says how large it had to be.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from links.vocabulary import Kind
from monitor.report.evidence_cases import Case
from monitor.settings import Settings

__all__ = ["Estimate", "Family", "Limit", "Subject", "limit_of", "subject_of"]

Floats = NDArray[np.float64]


class Family(StrEnum):
    """Kinds of what is watched that are drawn alike."""

    PITOT = "airspeed sensor"
    VANE = "vane"
    ACC = "accelerometer"
    GYRO = "gyro"
    SPOOL = "engine-speed channel"
    WING = "wing"
    ENGINE = "engine"


class Estimate(NamedTuple):
    """Columns of :meth:`monitor.report.flight.Flight.estimate`: a value and its deviation."""

    table: str
    column: str
    std: str


@dataclass(frozen=True, slots=True)
class Subject:
    """What there is to draw of one watched sensor.

    Attributes
    ----------
    sensor, family
    quantity
        What it measures, in words.
    unit
        Of everything but the tests.
    measured
        Name of :meth:`monitor.report.flight.Flight.measured`; None where nothing is measured.
    expected
        What it should have shown, the best witness first.
    error
        Its reconstructed error, where the estimator gives that itself; else it is measured less
        expected.
    peers
        The others of its kind, as they are measured.
    """

    sensor: str
    family: Family
    quantity: str
    unit: str
    measured: str | None = None
    expected: tuple[Estimate, ...] = ()
    error: Estimate | None = None
    peers: tuple[str, ...] = ()


_PLAIN: Final = re.compile(r"(airspeed|aoa|spool|engine)(\d+)")
_IMU: Final = re.compile(r"imu(\d+)\.((acc|gyro)_([xyz]))")
_WING: Final = re.compile(r"wing_(left|right)\.(lift|drag)")


def subject_of(sensor: str, streams: Iterable[str], settings: Settings) -> Subject | None:
    """What there is to draw of a watched sensor; None for a name of no known kind.

    Parameters
    ----------
    sensor
        As verdicts name it: ``"imu0.acc_x"``, ``"wing_left.lift"``, ``"engine0"`` ...
    streams
        Names of what was sent (``streams`` of the summary): the others of its kind are among them.
    settings
        Which shaft an engine-speed channel measures.
    """
    known = sorted(streams)
    if found := _PLAIN.fullmatch(sensor):
        quantity, number = found[1], int(found[2])
        peers = tuple(s for s in known if s.rstrip("0123456789") == quantity and s != sensor)
        if quantity == "airspeed":
            expected = (
                Estimate("air_expected", f"{sensor}_m_s", f"{sensor}_std_m_s"),
                Estimate("air", "cas_m_s", "cas_std_m_s"),
            )
            return Subject(sensor, Family.PITOT, "airspeed", "m/s", sensor, expected, None, peers)
        if quantity == "aoa":
            expected = (
                Estimate("air_expected", f"{sensor}_rad", f"{sensor}_std_rad"),
                Estimate("air", "aoa_rad", "aoa_std_rad"),
            )
            return Subject(
                sensor, Family.VANE, "angle of attack", "rad", sensor, expected, None, peers
            )
        if quantity == "spool":
            channel = settings.engine.channels.get(sensor)
            speeds = () if channel is None else (_shaft(channel.shaft),)
            return Subject(sensor, Family.SPOOL, "engine speed", "rpm", sensor, speeds, None, peers)
        spools = tuple(s for s in known if s.rstrip("0123456789") == "spool")
        return Subject(sensor, Family.ENGINE, f"engine {number}", "m/s", peers=spools)
    if found := _IMU.fullmatch(sensor):
        imu, axis, kind, letter = int(found[1]), found[2], found[3], found[4]
        family, unit, end = (
            (Family.ACC, "m/s^2", "m_s2") if kind == "acc" else (Family.GYRO, "rad/s", "rad_s")
        )
        what = f"specific force {letter}" if family is Family.ACC else f"rate {letter}"
        error = Estimate(
            f"imu{imu}", f"{kind}_{letter}_fault_{end}", f"{kind}_{letter}_fault_std_{end}"
        )
        freed = Estimate(f"imu{imu}", f"{kind}_{letter}_{end}", error.std)
        others = (s for s in known if re.fullmatch(r"imu\d+", s) and s != f"imu{imu}")
        peers = tuple(f"{s}.{axis}" for s in others)
        return Subject(sensor, family, what, unit, sensor, (freed,), error, peers)
    if found := _WING.fullmatch(sensor):
        side, what = found[1], found[2]
        name = "lift lost" if what == "lift" else "drag gained"
        column = f"{side}_{what}_percent"
        error = Estimate("wing", column, f"{what}_apart_std_percent")
        other = "left" if side == "right" else "right"
        return Subject(
            sensor, Family.WING, name, "%", error=error, peers=(f"{other}_{what}_percent",)
        )
    return None


def _shaft(shaft: int) -> Estimate:
    return Estimate("engine", f"speed_{shaft + 1}_rpm", f"speed_{shaft + 1}_std_rpm")


@dataclass(frozen=True, slots=True)
class Limit:
    """How large an error must be before a verdict may call it a fault.

    Attributes
    ----------
    low, high
        Bounds of the error [unit], or shares of what the sensor should show.
    relative
        Whether they are shares.
    key
        The setting that says so.
    """

    low: float
    high: float
    relative: bool
    key: str

    def bounds(self, expected: Floats | float) -> tuple[Floats, Floats]:
        """Lower and upper bound of the error where the sensor should show ``expected``."""
        of = np.abs(np.asarray(expected, np.float64))
        ones = np.ones_like(of) if not self.relative else of
        return self.low * ones, self.high * ones


def limit_of(case: Case, subject: Subject, settings: Settings) -> Limit | None:
    """The size that the error of this case was held to; None where none was.

    A value that stands still, a dead sensor and one that scatters are not judged by the size of
    their error.
    """
    if case.is_event or case.kind in (Kind.STUCK, Kind.DROPOUT, Kind.NOISE):
        return None
    estimator = str(case.found.get("estimator", ""))
    threshold = case.found.get("threshold")
    match subject.family:
        case Family.PITOT if estimator == "air_data_3d":
            return _logarithmic(settings.air.min_shift, "air.min_shift")
        case Family.PITOT if estimator == "air_horizon":
            return _logarithmic(settings.air.horizon.min_shift, "air.horizon.min_shift")
        case Family.PITOT if estimator == "air_checks" and case.kind is not Kind.OSCILLATION:
            return _logarithmic(settings.air.gross_ln, "air.gross_ln")
        case Family.VANE if estimator == "air_vane" and case.kind is not Kind.OSCILLATION:
            return _either(math.radians(settings.vane.least_deg), "vane.least_deg")
        case Family.PITOT | Family.VANE if estimator in ("air_vote", "air_mhe_3d"):
            key = "cas" if subject.family is Family.PITOT else "aoa"
            common = "common_" if estimator == "air_mhe_3d" else ""
            end = "m_s" if key == "cas" else "deg"
            name = f"common_{key}_{end}" if common else f"{key}_threshold_{end}"
            return None if threshold is None else _either(float(threshold), f"triplex.{name}")
        case Family.ACC:
            return _either(settings.imu.acc_size_m_s2, "imu.acc_size_m_s2")
        case Family.GYRO:
            return _either(settings.imu.gyro_size_rad_s, "imu.gyro_size_rad_s")
        case Family.WING:
            what = "lift" if subject.sensor.endswith("lift") else "drag"
            if threshold is None:
                return None
            return Limit(-math.inf, float(threshold), relative=False, key=f"wing.{what}_percent")
    return None


def _either(size: float, key: str) -> Limit:
    return Limit(-size, size, relative=False, key=key)


def _logarithmic(shift: float, key: str) -> Limit:
    return Limit(math.expm1(-shift), math.expm1(shift), relative=True, key=key)
