"""The charts of engines and wings: throttle, energy, engine speeds; what the wings lost."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from monitor.pages import palette
from monitor.pages.charts import TimeChart
from monitor.report import evidence_captions as captions
from monitor.report.evidence_data import Family, limit_of
from monitor.report.evidence_numbers import energy_height
from monitor.report.evidence_parts import ERROR, chart_of, draw_limits, ratio_chart
from monitor.report.evidence_scene import Scene
from monitor.report.section import Part, Text
from monitor.report.series import Series

__all__ = ["engine_charts", "power_charts", "wing_charts"]

TALL: Final = 240
LOW: Final = 140


def engine_charts(scene: Scene) -> Iterator[Part]:
    """An engine that stopped: what was asked of it, and what the aircraft's energy did."""
    yield from power_charts(scene)
    yield ratio_chart(scene)
    chart = scene.chart("speed", "m/s")
    told: list[tuple[str, Series | None, str]] = []
    for name, tone in (("airspeed0", palette.MEASURED), ("gps0.speed", palette.REFERENCE)):
        series = scene.measured(name)
        if series is not None:
            told.append((name, series, "m/s"))
            scene.line(chart, series, name, tone)
    if told:
        scene.mark(chart)
        yield chart_of(scene, "speed", chart, captions.change_sentence(scene, told))
    shown = scene.peers()
    if not shown:
        yield Text("No engine speed was recorded: throttle and energy decided alone.", "soft")
        return
    chart = scene.chart("engine speed", "rpm")
    for (name, series), tone in zip(shown, palette.MORE * 4, strict=False):
        scene.line(chart, series, name, tone)
    scene.mark(chart)
    changed = captions.change_sentence(scene, [(n, s, "rpm") for n, s in shown])
    yield chart_of(scene, "spools", chart, changed)


def power_charts(scene: Scene) -> Iterator[Part]:
    """Throttle, and the aircraft's energy."""
    percent = _percent(scene.measured("throttle"))
    first = scene.subject.family is Family.ENGINE
    if percent is None:
        yield Text("The throttle output was not recorded at this time.", "soft")
    else:
        chart = scene.chart("throttle", "%")
        scene.line(chart, percent, "throttle output", palette.MEASURED)
        scene.mark(chart, words=first)
        said = captions.level(percent, scene.case.onset_s, scene.case.isolated_s)
        yield chart_of(scene, "throttle", chart, f"What was asked of the engine. {said}")
    power = scene.column("engine", "climb_power_m_s")
    if power is not None:
        chart = scene.chart("climb power", "m/s")
        scene.line(chart, power, "climb that engine and drag would give", palette.MORE[2])
        chart.threshold(0.0, name="height kept")
        scene.mark(chart)
        said = captions.change_sentence(scene, [("it", power, "m/s")])
        yield chart_of(
            scene, "power", chart, f"Below zero the aircraft lives on its height. {said}"
        )
        return
    speed = scene.measured("airspeed0") or scene.measured("gps0.speed")
    energy = energy_height(scene.measured("altitude"), speed)
    if energy is None:
        yield Text("Height or speed was not recorded: the energy is not drawn.", "soft")
        return
    chart = scene.chart("energy height", "m")
    scene.line(chart, energy, "height + V²/2g", palette.MORE[2])
    scene.mark(chart)
    case = scene.case
    said = captions.slope(energy, case.onset_s, case.isolated_s)
    yield chart_of(scene, "energy", chart, f"Height that giving up the speed would reach. {said}")


def wing_charts(scene: Scene) -> Iterator[Part]:
    """What both wings lost or gained, and by how much they are apart."""
    subject = scene.subject
    what = "lift" if subject.sensor.endswith("lift") else "drag"
    own = scene.error
    other = scene.column("wing", subject.peers[0])
    if own is None or other is None:
        yield Text("The wings were not estimated at this time.", "soft")
        return
    side = subject.sensor.partition(".")[0].removeprefix("wing_")
    facing = "left" if side == "right" else "right"
    chart = scene.chart(subject.quantity, "%", TALL)
    scene.line(chart, own, f"{side} wing", ERROR)
    scene.line(chart, other, f"{facing} wing", palette.REFERENCE)
    scene.mark(chart, words=True)
    told = captions.change_sentence(
        scene, [(f"the {side} wing's", own, "%"), (f"the {facing} wing's", other, "%")]
    )
    yield chart_of(scene, "wings", chart, f"What both have in common is hardly observable. {told}")
    apart = Series(own.t_s, own.low - other.low, own.high - other.high, "%")
    scene.error = apart
    limit = limit_of(scene.case, subject, scene.flight.settings)
    chart = scene.chart(f"{what}, {side} − {facing}", "%")
    scene.band(chart, apart, scene.error_std, "2σ of it")
    scene.line(chart, apart, f"{side} less {facing}", ERROR)
    draw_limits(scene, chart, limit)
    scene.mark(chart)
    yield chart_of(scene, "error", chart, captions.error(scene, limit))
    yield ratio_chart(scene)
    yield _flown(scene)


def _flown(scene: Scene) -> Part:
    """Airspeed, roll and throttle: the manoeuvre in which a wing was judged."""
    models: list[TimeChart] = []
    said: list[tuple[str, Series, str]] = []
    rows = (
        ("airspeed", "m/s", scene.measured("airspeed0")),
        ("roll", "rad", scene.measured("roll")),
        ("throttle", "%", _percent(scene.measured("throttle"))),
    )
    for (label, unit, series), tone in zip(rows, palette.MORE, strict=False):
        if series is not None:
            chart = scene.chart(label, unit, LOW)
            scene.line(chart, series, label, tone)
            models.append(scene.mark(chart))
            said.append((label, series, unit))
    if not models:
        return Text("Neither airspeed nor attitude was recorded at this time.", "soft")
    told = captions.change_sentence(scene, said)
    return chart_of(scene, "flown", models, f"The manoeuvre in which it was judged. {told}")


def _percent(share: Series | None) -> Series | None:
    """A share of the travel in percent."""
    if share is None:
        return None
    return Series(share.t_s, 100.0 * share.low, 100.0 * share.high, "%")
