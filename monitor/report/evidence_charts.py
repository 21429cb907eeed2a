"""The charts of a finding: measured, error, test statistic, and what the others did meanwhile.

Each function gives one chart, or a sentence where there is nothing to draw: no chart is empty.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from links.vocabulary import Kind
from monitor.pages import palette
from monitor.report import evidence_captions as captions
from monitor.report.evidence_data import Family
from monitor.report.evidence_inertial import (
    dead_charts,
    inertial_measured,
    motion_chart,
    others_inertial,
)
from monitor.report.evidence_machine import engine_charts, power_charts, wing_charts
from monitor.report.evidence_numbers import coarser
from monitor.report.evidence_parts import (
    chart_of,
    differences,
    error_chart,
    ratio_chart,
    scatter_chart,
)
from monitor.report.evidence_scene import POINTS, Scene
from monitor.report.section import Part, Text
from monitor.report.series import Series

__all__ = ["charts_of"]

TALL: Final = 240


def charts_of(scene: Scene) -> Iterator[Part]:
    """All charts of a finding, in the order in which they convince."""
    scatters = scene.case.kind in (Kind.NOISE, Kind.OSCILLATION)
    match scene.subject.family:
        case Family.ENGINE:
            yield from engine_charts(scene)
        case Family.WING:
            yield from wing_charts(scene)
        case Family.ACC | Family.GYRO if len(scene.group.sensors) > 1:
            yield from dead_charts(scene)
            yield ratio_chart(scene)
            yield motion_chart(scene)
        case Family.ACC | Family.GYRO:
            yield inertial_measured(scene)
            yield error_chart(scene)
            if scatters:
                yield scatter_chart(scene)
            yield ratio_chart(scene)
            yield others_inertial(scene)
            yield motion_chart(scene)
        case family:
            yield measured_chart(scene)
            yield error_chart(scene)
            if scatters:
                yield scatter_chart(scene)
            yield ratio_chart(scene)
            yield others_chart(scene)
            if family is Family.SPOOL:
                yield from power_charts(scene)
            else:
                yield wind_chart(scene)


def measured_chart(scene: Scene) -> Part:
    """What the sensor measured, over what it should have shown."""
    subject = scene.subject
    if scene.own is None and scene.expected is None:
        return Text(f"Nothing of {subject.sensor} was recorded at this time.", "soft")
    chart = scene.chart(subject.quantity, subject.unit, TALL)
    scene.line(chart, scene.own, f"{subject.sensor} measured", palette.MEASURED)
    scene.line(chart, scene.expected, "should have shown", palette.RECONSTRUCTED)
    scene.band(chart, scene.expected, scene.expected_std, "2σ of it")
    if scene.expected is None and subject.family is Family.PITOT:
        ground = scene.measured("gps0.speed")
        scene.line(chart, ground, "GPS ground speed", palette.REFERENCE, "dashed")
    scene.mark(chart, words=True)
    return chart_of(scene, "measured", chart, captions.measured(scene))


def others_chart(scene: Scene) -> Part:
    """The others of its kind, and for air data the speed over the ground."""
    subject = scene.subject
    compared: list[tuple[str, Series | None]] = list(scene.peers())
    if subject.family is Family.PITOT:
        compared.append(("GPS ground speed", scene.measured("gps0.speed")))
    drawn = [(name, series) for name, series in compared if series is not None]
    if not drawn:
        return Text(f"There was nothing of its kind to compare {subject.sensor} with.", "soft")
    chart = scene.chart(subject.quantity, subject.unit)
    scene.line(chart, scene.own, f"{subject.sensor} (faulty)", palette.BAND, "dotted")
    tones = iter((*palette.MORE[1:], palette.MEASURED) * 4)
    for name, series in drawn:
        dash = "dashed" if name.startswith("GPS") else ""
        scene.line(chart, series, name, next(tones), dash)
    scene.mark(chart)
    caption = captions.others(scene, compared)
    apart, told = differences(scene, scene.peers())
    if not told:
        return chart_of(scene, "others", chart, caption)
    scene.mark(apart)
    return chart_of(scene, "others", [chart, apart], f"{caption} {captions.apart(scene, told)}")


def wind_chart(scene: Scene) -> Part:
    """The estimated wind: had it changed, the pitot would not be at fault."""
    axes = ("north", "east", "down") if scene.subject.family is Family.VANE else ("north", "east")
    found = []
    for axis, tone in zip(axes, palette.AXES, strict=False):
        wind = scene.column("air", f"wind_{axis}_m_s")
        found.append((axis, wind, scene.column("air", f"wind_{axis}_std_m_s"), tone))
    if all(wind is None for _, wind, _, _ in found):
        return Text("No wind was estimated at this time.", "soft")
    chart = scene.chart("wind toward", "m/s")
    for axis, wind, _, tone in found:
        scene.line(chart, wind, axis, tone)
    for axis, wind, std, tone in found:
        if wind is not None and std is not None:
            chart.deviation(coarser(wind, POINTS), coarser(std, POINTS), f"2σ {axis}", tone)
    scene.mark(chart)
    return chart_of(scene, "wind", chart, captions.wind(scene, found[0][1], found[1][1]))
