"""Section: engine speeds against the reconstruction, throttle, power."""

from __future__ import annotations

from typing import TYPE_CHECKING

from monitor.pages import palette
from monitor.pages.charts import TimeChart, time_chart
from monitor.report.panels import (
    TESTS_SAID,
    Derived,
    Tested,
    instances,
    settled,
    shade_faults,
    shaded_words,
    stacked,
    tests_chart,
)
from monitor.report.section import Chart, Section
from monitor.report.wording import listed
from monitor.verdict import N_SHAFTS

if TYPE_CHECKING:
    from bokeh.models import Range1d

    from monitor.report.flight import Flight

__all__ = ["section"]


def section(flight: Flight, axis: Range1d) -> Section | None:
    """Speeds, throttle and climb power; None without any of them."""
    speeds, throttle, power = (make(flight, axis) for make in (_speeds, _throttle, _power))
    channels = instances(flight, "spool")
    tested = [
        *(Tested(s, s, palette.MORE[k % len(palette.MORE)]) for k, s in enumerate(channels)),
        *(Tested(f"engine{k}", f"engine{k}", palette.SOFT, "dashed") for k in range(N_SHAFTS)),
    ]
    tests = tests_chart(flight, axis, tested)
    charts = stacked([speeds, throttle, power, tests])
    if not charts:
        return None
    shade_faults(charts, flight)
    said = _said(flight, channels)
    return Section(
        "engine",
        "Engine",
        said,
        [
            Chart(
                "engine-speeds",
                charts,
                _caption(power) + (f" {TESTS_SAID}" if tests.legend else ""),
                f"Time charts of the engine. {said}{shaded_words(flight.summary)}",
            )
        ],
    )


def _said(flight: Flight, channels: list[str]) -> str:
    """What the channels are held against."""
    if not channels:
        return "No engine speed in this log; throttle and power are watched without it."
    shafts = (flight.estimate("engine", f"speed_{k + 1}_rpm") for k in range(N_SHAFTS))
    known = any(shaft is not None for shaft in shafts)
    modelled = [c for c in channels if known and c in flight.settings.engine.channels]
    bare = [c for c in channels if c not in modelled]
    said = []
    if modelled:
        said.append(f"{listed(modelled)} against the engine's model, with its 2-sigma band.")
    if bare:
        said.append(
            f"{listed(bare)} without a model of the engine: only a dead or a stuck channel is "
            "found (mavsentry learn engine)."
        )
    return " ".join(said)


def _caption(power: TimeChart) -> str:
    said = "Throttle as its servo output commands it."
    if power.legend:
        said += (
            " Climb power is the climb rate that engine and drag together would have given at "
            "constant airspeed: at zero the aircraft just keeps its height, without power it sinks."
        )
    return said


def _speeds(flight: Flight, axis: Range1d) -> TimeChart:
    chart = time_chart(axis, "engine speed", "rpm", height=240)
    for k, sensor in enumerate(instances(flight, "spool")):
        tone = palette.MORE[k % len(palette.MORE)]
        chart.line(flight.measured(sensor), sensor, tone, width=1.2)
    for k in range(N_SHAFTS):
        mean = flight.estimate("engine", f"speed_{k + 1}_rpm")
        std = flight.estimate("engine", f"speed_{k + 1}_std_rpm")
        name = "reconstructed" if k == 0 else f"reconstructed, shaft {k}"
        chart.line(mean, name, palette.RECONSTRUCTED, width=1.2)
        chart.deviation(settled(mean, std), std)
    chart.legend = list(dict.fromkeys(chart.legend))
    return chart


def _throttle(flight: Flight, axis: Range1d) -> TimeChart:
    chart = time_chart(axis, "throttle", "%", height=150, y_bounds=(0.0, 100.0))
    share = flight.measured("throttle") or flight.estimate("engine", "throttle")
    if share is not None:
        chart.line(Derived.scaled(share, 100.0, "%"), "throttle", palette.REFERENCE)
    return chart


def _power(flight: Flight, axis: Range1d) -> TimeChart:
    chart = time_chart(axis, "climb power", "m/s", height=160)
    chart.line(flight.estimate("engine", "climb_power_m_s"), "climb power", palette.MORE[3])
    if chart.legend:
        chart.threshold(0.0, name="height kept")
    return chart
