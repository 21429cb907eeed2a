"""Section: airspeed, angles and wind of the whole flight."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from monitor.pages import palette
from monitor.pages.charts import TimeChart, time_chart
from monitor.report.panels import (
    TESTS_SAID,
    Derived,
    Tested,
    banded,
    instances,
    shade_faults,
    shaded_words,
    stacked,
    tests_chart,
)
from monitor.report.section import Chart, Part, Section
from monitor.report.wording import listed

if TYPE_CHECKING:
    from bokeh.models import Range1d

    from monitor.pages.charts import Curve
    from monitor.report.flight import Flight

__all__ = ["section"]

FAR = 2.5
"""A reading that makes the chart so many times as high as the reconstruction needs is far off."""
UNKNOWN_M_S = 4.0
"""A wind known no better than this is not drawn: its band would be all there is to see [m/s]."""


def section(flight: Flight, axis: Range1d) -> Section | None:
    """Airspeeds against the reconstruction, angles against vanes, the wind; None without any."""
    pitots, vanes = instances(flight, "airspeed"), instances(flight, "aoa")
    parts: list[Part] = [
        *_speeds(flight, axis, pitots),
        *_angles(flight, axis, vanes),
        *_wind(flight, axis, vanes),
    ]
    if not parts:
        return None
    lead = (
        "What the air did, out of satellite velocity, attitude and the sensors that agree. "
        "Airspeed and angles are of the moment, gusts included; the wind is the mean wind."
    )
    return Section("air", "Air data and wind", lead, parts)


def _speeds(flight: Flight, axis: Range1d, pitots: list[str]) -> list[Part]:
    cas = time_chart(axis, "calibrated airspeed", "m/s", height=240)
    _draw_speeds(cas, flight, pitots)
    around = _around(flight, pitots)
    near = time_chart(axis, "the same, near", "m/s", height=220, y_range=around)
    if around is not None:
        _draw_speeds(near, flight, pitots)
    over = time_chart(axis, "speed", "m/s")
    over.line(flight.estimate("air", "tas_m_s"), "true airspeed", palette.RECONSTRUCTED)
    over.line(flight.measured("gps0.speed"), "ground speed (gps0)", palette.MORE[4])
    tests = tests_chart(flight, axis, _tested(pitots))
    charts = stacked([cas, near, over, tests])
    if not charts:
        return []
    shade_faults(charts, flight)
    against = _against(flight, pitots)
    closer = "; the same again near the reconstruction" if around is not None else ""
    return [
        Chart(
            "air-speed",
            charts,
            f"{against}{closer}; below it true airspeed and speed over ground."
            f"{' ' + TESTS_SAID if tests.legend else ''}",
            f"Time chart. {against} and its 2-sigma band; true airspeed and ground speed."
            f"{shaded_words(flight.summary)}",
        )
    ]


def _against(flight: Flight, pitots: list[str]) -> str:
    if not pitots:
        return "No pitot in this log"
    if flight.estimate("air", "cas_m_s") is None:
        return f"{listed(pitots)} as measured; nothing was reconstructed"
    return f"{listed(pitots)} against the reconstruction"


def _tested(sensors: list[str]) -> list[Tested]:
    return [Tested(s, s, tone) for s, tone in zip(sensors, palette.MORE, strict=False)]


def _draw_speeds(chart: TimeChart, flight: Flight, pitots: list[str]) -> None:
    for tone, sensor in zip(palette.MORE, pitots, strict=False):
        chart.line(flight.measured(sensor), sensor, tone, width=1.2)
    mean = flight.estimate("air", "cas_m_s")
    chart.line(mean, "reconstructed", palette.RECONSTRUCTED, width=1.2)
    chart.deviation(mean, flight.estimate("air", "cas_std_m_s"))


def _around(flight: Flight, pitots: list[str]) -> Range1d | None:
    """Range about the reconstruction, where readings far from it leave it no room; else None."""
    from bokeh.models import Range1d

    mean, std = flight.estimate("air", "cas_m_s"), flight.estimate("air", "cas_std_m_s")
    if mean is None or std is None or not np.isfinite(mean.low).any():
        return None
    least = float(np.nanmin(mean.low - 2.0 * std.high))
    most = float(np.nanmax(mean.high + 2.0 * std.high))
    shown = [c for c in map(flight.measured, pitots) if c is not None]
    all_most = max([most, *(float(np.nanmax(c.high)) for c in shown)])
    if all_most - least < FAR * (most - least):
        return None
    room = 0.15 * (most - least)
    return Range1d(max(least - room, 0.0), most + room)


def _angles(flight: Flight, axis: Range1d, vanes: list[str]) -> list[Part]:
    aoa = time_chart(axis, "angle of attack", "rad")
    for tone, sensor in zip(palette.MORE, vanes, strict=False):
        aoa.line(flight.measured(sensor), sensor, tone, width=1.2)
    _estimated(aoa, flight, "aoa_rad", "aoa_std_rad")
    slip = time_chart(axis, "sideslip", "rad", height=160)
    _estimated(slip, flight, "ssa_rad", "ssa_std_rad")
    tests = tests_chart(flight, axis, _tested(vanes))
    charts = stacked([aoa, slip, tests])
    if not charts:
        return []
    shade_faults(charts, flight)
    against = (
        f"{listed(vanes)} against the reconstruction"
        if vanes
        else "No vane in this log: the angles are those of the reconstruction alone"
    )
    return [
        Chart(
            "air-angles",
            charts,
            f"{against}. Sideslip is positive with the wind from the right."
            f"{' ' + TESTS_SAID if tests.legend else ''}",
            f"Time chart of angle of attack and sideslip in degrees. {against}."
            f"{shaded_words(flight.summary)}",
        )
    ]


def _estimated(chart: TimeChart, flight: Flight, value: str, std: str) -> None:
    mean = flight.estimate("air", value)
    chart.line(mean, "reconstructed", palette.RECONSTRUCTED, width=1.2)
    chart.deviation(mean, flight.estimate("air", std))


def _wind(flight: Flight, axis: Range1d, vanes: list[str]) -> list[Part]:
    names = ["north", "east", *(["down"] if vanes else [])]
    level = time_chart(axis, "wind toward", "m/s")
    shown = []
    for name, tone in zip(names, palette.AXES, strict=False):
        mean = flight.estimate("air", f"wind_{name}_m_s")
        std = flight.estimate("air", f"wind_{name}_std_m_s")
        if mean is None or std is None:
            continue
        known = _where_known(mean, std)
        banded(level, known, std, name, tone)
        shown.append(known)
    if not level.legend:
        return []
    (level,) = stacked([level])
    shade_faults([level], flight)
    last = _last_wind(shown)
    unseen = "" if vanes else " Without vanes the vertical wind cannot be observed."
    return [
        Chart(
            "air-wind",
            level,
            f"The way the air moves, each line with its 2-sigma band, from when it is known to "
            f"{UNKNOWN_M_S:.0f} m/s (1σ).{unseen}{last}",
            f"Time chart of the wind's components {listed(names)}.{last}"
            f"{shaded_words(flight.summary)}",
        )
    ]


def _where_known(mean: Curve, std: Curve) -> Derived:
    known = std.high <= UNKNOWN_M_S
    low, high = (np.where(known, values, np.nan) for values in (mean.low, mean.high))
    return Derived(mean.t_s, low, high, mean.unit)


def _last_wind(shown: list[Derived]) -> str:
    """The last wind as people say it: where it comes from."""
    if len(shown) < 2:
        return ""
    north, east = shown[0].low, shown[1].low
    known = np.flatnonzero(np.isfinite(north) & np.isfinite(east))
    if not known.size:
        return ""
    n, e = float(north[known[-1]]), float(east[known[-1]])
    from_deg = np.degrees(np.arctan2(-e, -n)) % 360.0
    return f" At the end it came from {from_deg:.0f}° at {np.hypot(n, e):.1f} m/s."
