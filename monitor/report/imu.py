"""Section: the reconstructed faults of every IMU's axes, against what would be called a fault."""

from __future__ import annotations

from typing import TYPE_CHECKING

from monitor.pages import palette
from monitor.pages.charts import LegendEntry, TimeChart, time_chart
from monitor.report.panels import (
    TESTS_SAID,
    Tested,
    banded,
    instances,
    shade_faults,
    shaded_words,
    stacked,
    tests_chart,
)
from monitor.report.section import Chart, Part, Section

if TYPE_CHECKING:
    from bokeh.models import Range1d

    from monitor.report.flight import Flight

__all__ = ["section"]


def section(flight: Flight, axis: Range1d) -> Section | None:
    """A chart per IMU; None where no IMU's faults were reconstructed."""
    parts: list[Part] = []
    for imu in instances(flight, "imu"):
        acc = time_chart(axis, "acc error", "m/s^2")
        gyro = time_chart(axis, "gyro error", "rad/s")
        _axes(acc, flight, imu, "acc", "m_s2", flight.settings.imu.acc_size_m_s2, "m/s^2")
        _axes(gyro, flight, imu, "gyro", "rad_s", flight.settings.imu.gyro_size_rad_s, "rad/s")
        tests = _tests(flight, axis, imu)
        charts = stacked([acc, gyro, tests])
        if not charts:
            continue
        shade_faults(charts, flight)
        parts.append(
            Chart(
                f"imu-{imu}",
                charts,
                f"{imu}: reconstructed error of each axis with its 2-sigma band. The dashed lines "
                f"are the least change that is called a fault; an offset from the start is a "
                f"turn-on bias, and none.{' ' + TESTS_SAID if tests.legend else ''}",
                f"Time charts of {imu}: errors of the three accelerometers and the three gyros."
                f"{shaded_words(flight.summary)}",
            )
        )
    if not parts:
        return None
    lead = (
        "By how much each axis was off, as reconstructed from satellite velocity, static pressure, "
        "attitude and the other IMUs. An axis in order stays where it began, but for a slow drift."
    )
    return Section("imu", "IMU errors", lead, parts)


def _tests(flight: Flight, axis: Range1d, imu: str) -> TimeChart:
    """Tests of the six axes; the legend names the colours once and the two kinds by their lines."""
    shown = [
        Tested(f"{imu}.{kind}_{letter}", f"{kind} {letter}", tone, dash)
        for kind, dash in (("acc", "solid"), ("gyro", "dotted"))
        for letter, tone in zip("xyz", palette.AXES, strict=True)
    ]
    chart = tests_chart(flight, axis, shown)
    if chart.legend:
        others = [entry for entry in chart.legend if not entry.name.startswith(("acc", "gyro"))]
        kinds = [
            LegendEntry("test of acc", palette.INK),
            LegendEntry("of gyro", palette.INK, "dotted"),
        ]
        chart.legend = [*kinds, *others]
    return chart


def _axes(
    chart: TimeChart,
    flight: Flight,
    imu: str,
    kind: str,
    end: str,
    size: float,
    unit: str,
) -> None:
    for axis, tone in zip("xyz", palette.AXES, strict=True):
        mean = flight.estimate(imu, f"{kind}_{axis}_fault_{end}")
        std = flight.estimate(imu, f"{kind}_{axis}_fault_std_{end}")
        banded(chart, mean, std, axis, tone)
    if chart.legend:
        chart.threshold(-size, size, name="least change that is a fault", unit=unit)
