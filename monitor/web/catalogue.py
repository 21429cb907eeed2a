"""The charts that the live page may show: for each its lines, and the columns that these draw.

A column is a name of what a frame says (:mod:`monitor.web.protocol`): ``airspeed0`` is a measured
channel, ``airspeed0.test`` a test ratio, ``air.cas_m_s`` and ``imu0.acc_fault_m_s2.2`` numbers of
an estimate. The page keeps these columns and no others, and shows a chart once one of its columns
has a number.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from links.vocabulary import GYRO_ACC_AXES
from monitor.pages.palette import AXES, MORE, RECONSTRUCTED, Tone

__all__ = ["IMUS", "Chart", "Curve", "charts"]

IMUS: Final = 5
PITOTS: Final = 3
VANES: Final = 3
SHAFTS: Final = 4


@dataclass(frozen=True, slots=True)
class Curve:
    """One line of a chart.

    Attributes
    ----------
    column
        What it draws.
    label
        Its name in the key.
    tone
        Its colour.
    std
        Column with one standard deviation of it: a band of two is drawn. None: no band.
    dash
        ``"solid"``, ``"dashed"`` or ``"dotted"``.
    width
        Of the line [px].
    """

    column: str
    label: str
    tone: Tone
    std: str | None = None
    dash: str = "solid"
    width: float = 1.5


@dataclass(frozen=True, slots=True)
class Chart:
    """One chart.

    Attributes
    ----------
    key
        Names its place on the page.
    title, unit
        Its heading.
    about
        What it shows, in a sentence for those who do not see it.
    lines
        In the order of the key; the last is drawn on top.
    least
        Smallest span of its axis, in its unit: noise does not fill the chart.
    ratio
        Of test ratios: a logarithmic axis with the threshold at 1.
    """

    key: str
    title: str
    unit: str
    about: str
    lines: tuple[Curve, ...]
    least: float = 1.0
    ratio: bool = False


def charts() -> Iterator[Chart]:
    """Every chart there may be, in the order of the page.

    Those of ``imu0`` stand for all :data:`IMUS`, kind by kind.
    """
    yield _beside("airspeed", "Airspeed (calibrated)", "m/s", PITOTS, "air.cas_m_s", least=4.0)
    yield _beside("aoa", "Angle of attack", "°", VANES, "air.aoa_deg", least=3.0)
    wind = _vector("air.wind_ned_m_s", "air.wind_std_ned_m_s", ("north", "east", "down"))
    yield Chart("wind", "Wind, as the air moves", "m/s", "Estimated wind.", wind, least=4.0)
    yield _tests("air", "Air data", [*_named("airspeed", PITOTS), *_named("aoa", VANES)])
    yield from _imu("imu0")
    yield _engine()
    yield _tests("engine", "Engine speeds", list(_named("spool", SHAFTS)))
    yield _wing()
    parts = [f"wing_{side}.{what}" for side in ("left", "right") for what in ("lift", "drag")]
    yield _tests("wing", "Wings", parts)


def _named(sensor: str, count: int) -> Iterator[str]:
    return (f"{sensor}{i}" for i in range(count))


def _beside(key: str, title: str, unit: str, count: int, estimate: str, least: float) -> Chart:
    """Sensors beside what they should read."""
    tones = (MORE[0], MORE[1], MORE[3])
    group, _, name = estimate.partition(".")
    stem, _, suffix = name.partition("_")
    std = f"{group}.{stem}_std_{suffix}"
    measured = tuple(Curve(f"{key}{i}", f"{key}{i}", tone) for i, tone in enumerate(tones[:count]))
    own = Curve(estimate, "reconstructed", RECONSTRUCTED, std, width=2.0)
    about = f"{title}: measured, and reconstructed with two standard deviations."
    return Chart(key, title, unit, about, (own, *measured), least)


def _vector(column: str, std: str, names: tuple[str, str, str]) -> tuple[Curve, ...]:
    return tuple(
        Curve(f"{column}.{i}", name, tone, f"{std}.{i}")
        for i, (name, tone) in enumerate(zip(names, AXES, strict=True))
    )


def _imu(imu: str) -> Iterator[Chart]:
    about = f"Estimated faults of {imu} by axis, with two standard deviations; 0 is healthy."
    acc = _vector(f"{imu}.acc_fault_m_s2", f"{imu}.acc_fault_std_m_s2", ("x", "y", "z"))
    gyro = _vector(f"{imu}.gyro_fault_deg_s", f"{imu}.gyro_fault_std_deg_s", ("x", "y", "z"))
    yield Chart(f"{imu}-acc", f"{imu}: fault of specific force", "m/s²", about, acc, least=1.0)
    yield Chart(f"{imu}-gyro", f"{imu}: fault of turn rate", "°/s", about, gyro, least=2.0)
    yield _tests(imu, imu, [f"{imu}.{axis}" for axis in GYRO_ACC_AXES])


def _tests(key: str, title: str, sensors: list[str]) -> Chart:
    """Ratios to the threshold: the first half of the sensors solid, the others dotted."""
    half = (len(sensors) + 1) // 2
    lines = tuple(
        Curve(
            f"{sensor}.test",
            sensor.removeprefix(f"{key}.").removeprefix("wing_").replace(".", " "),
            MORE[i % half],
            dash="solid" if i < half else "dotted",
        )
        for i, sensor in enumerate(sensors)
    )
    about = f"{title}: test statistics over their thresholds; above 1 a sensor is suspected."
    return Chart(f"{key}-tests", f"{title}: tests", "1 = threshold", about, lines, ratio=True)


def _engine() -> Chart:
    lines = tuple(
        line
        for i in range(SHAFTS)
        for line in (
            Curve(
                f"engine.speed_rpm.{i}",
                f"reconstructed {i}",
                MORE[i],
                f"engine.speed_std_rpm.{i}",
                dash="dashed",
            ),
            Curve(f"spool{i}", f"spool{i}", MORE[i]),
        )
    )
    about = "Speeds of the shafts: measured, and reconstructed with two standard deviations."
    return Chart("engine", "Engine speeds", "rpm", about, lines, least=200.0)


def _wing() -> Chart:
    lines = tuple(
        Curve(
            f"wing.{side}_{what}_percent",
            f"{side} {word}",
            tone,
            f"wing.{side}_{what}_std_percent",
            dash,
        )
        for side, tone in (("left", MORE[0]), ("right", MORE[1]))
        for what, word, dash in (("lift", "lift lost", "solid"), ("drag", "drag gained", "dashed"))
    )
    about = "Lift lost and drag gained by each wing, with two standard deviations; 0 is healthy."
    return Chart("wing", "Wings", "%", about, lines, least=10.0)
