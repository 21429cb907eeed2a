"""The charts of an IMU's axis: samples and their means, the other IMUs, how the aircraft moved.

Vibration is many times a fault's size, so that samples alone show nothing: means over a second do,
and best of all the difference from another IMU, which feels the same vibration.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from links.vocabulary import GYRO_ACC_AXES
from monitor.pages import palette
from monitor.report import evidence_captions as captions
from monitor.report.evidence_data import Family, limit_of
from monitor.report.evidence_numbers import coarser, smoothed, value_at
from monitor.report.evidence_parts import chart_of, differences, draw_limits
from monitor.report.evidence_scene import POINTS, Scene
from monitor.report.section import Part, Text
from monitor.report.series import Series

__all__ = ["dead_charts", "inertial_measured", "motion_chart", "others_inertial"]

TALL = 240


def inertial_measured(scene: Scene) -> Part:
    """All samples, their mean over a second, and that mean less the reconstructed error."""
    subject, own = scene.subject, scene.own
    if own is None:
        return Text(f"Nothing of {subject.sensor} was recorded at this time.", "soft")
    chart = scene.chart(subject.quantity, subject.unit, TALL)
    mean = smoothed(own)
    scene.line(chart, mean, f"{subject.sensor} measured, 1 s mean", palette.MEASURED)
    freed = None
    if mean is not None and scene.error is not None:
        should = mean.middle - value_at(scene.error, mean.t_s)
        freed = Series(mean.t_s, should, should, mean.unit)
        scene.line(chart, freed, "less the reconstructed error", palette.RECONSTRUCTED)
        scene.band(chart, freed, scene.error_std, "2σ of it")
    thin = coarser(own, POINTS)
    if thin is not None:
        low = Series(thin.t_s, thin.low, thin.low, thin.unit)
        high = Series(thin.t_s, thin.high, thin.high, thin.unit)
        chart.band(low, high, "all samples", palette.MEASURED)
    scene.mark(chart, words=True)
    return chart_of(scene, "measured", chart, captions.inertial(scene, mean, freed))


def dead_charts(scene: Scene) -> Iterator[Part]:
    """Axes of one IMU that died or froze together: what each of them read."""
    imu = scene.subject.sensor.partition(".")[0]
    first = True
    for kind, label, unit in (("acc", "specific force", "m/s^2"), ("gyro", "rate", "rad/s")):
        axes = [axis for axis in GYRO_ACC_AXES if axis.startswith(kind)]
        if not any(f"{imu}.{axis}" in scene.group.sensors for axis in axes):
            continue
        chart = scene.chart(label, unit, TALL)
        reads = []
        for axis, tone in zip(axes, palette.AXES, strict=True):
            series = scene.measured(f"{imu}.{axis}")
            scene.line(chart, series, axis, tone)
            read = value_at(series, scene.said_s)
            if math.isfinite(read):
                reads.append(f"{axis} {captions.signed(read, unit)}")
        if not reads:
            yield Text(f"No {label} of {imu} was recorded at this time.", "soft")
            continue
        scene.mark(chart, words=first)
        first = False
        said = f"{scene.when} they read {', '.join(reads)}."
        yield chart_of(scene, kind, chart, said)


def others_inertial(scene: Scene) -> Part:
    """Differences between IMUs: who left whom."""
    subject, peers = scene.subject, scene.peers()
    if scene.own is None or not peers:
        return Text(
            f"No other IMU was there to compare {subject.sensor} with: its own filters decided.",
            "soft",
        )
    chart, told = differences(scene, peers)
    if not told:
        return Text(f"The IMUs have no samples of the same time as {subject.sensor}.", "soft")
    draw_limits(scene, chart, limit_of(scene.case, subject, scene.flight.settings))
    scene.mark(chart)
    return chart_of(scene, "others", chart, captions.apart(scene, told))


def motion_chart(scene: Scene) -> Part:
    """How the aircraft moved: what its error would have had to make of it."""
    subject = scene.subject
    label, unit, named = _motion_of(subject.sensor, subject.family)
    chart = scene.chart(label, unit)
    told = []
    for (name, key), tone in zip(named, palette.MORE[2:], strict=False):
        series = scene.measured(key)
        if series is not None:
            told.append((name, series, unit))
            scene.line(chart, series, name, tone)
    if not told:
        return Text("How the aircraft moved was not recorded at this time.", "soft")
    scene.mark(chart)
    return chart_of(scene, "motion", chart, captions.motion(scene, told, unit))


def _motion_of(sensor: str, family: Family) -> tuple[str, str, list[tuple[str, str]]]:
    """Label, unit and curves of the motion that an axis would change."""
    if family is Family.ACC:
        if sensor.endswith("z"):
            return "height", "m", [("barometric height", "baro_altitude")]
        return "speed", "m/s", [("GPS ground speed", "gps0.speed")]
    if sensor.endswith("z"):
        return "heading", "rad", [("heading", "heading"), ("GPS course", "gps0.course")]
    return "attitude", "rad", [("roll", "roll"), ("pitch", "pitch")]
