"""Pictures of ``verdict.md``: one synthetic flight with two broken pitots, from take-off on."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes

from drawing.flights import Judged, judged
from drawing.style import (
    FAULT,
    GREY,
    MEASURED,
    OTHER,
    RECONSTRUCTED,
    STATES,
    TRUE,
    canvas,
    save,
)
from links.vocabulary import State
from monitor.settings import load

FLIGHT: Final = "small-uav-pitot-blockage"
EXPLANATIONS: Final = (
    (2, "airspeed1 shifted", MEASURED, "-"),
    (1, "airspeed0 shifted", OTHER, "-"),
    (3, "both shifted", GREY, "--"),
    (0, "the wind changed", RECONSTRUCTED, "-"),
)
"""Mask of the bank's explanation, its name, colour and line."""


def _strip(axes: Axes, flight: Judged, sensors: list[str], begin: float, end: float) -> None:
    """A bar for each sensor: its state over time."""
    for row, sensor in enumerate(reversed(sensors)):
        said = flight.verdicts(sensor)
        edges = [flight.seconds(np.array(v.t_us)) for v in said] + [end]
        for verdict, left, right in zip(said, edges, edges[1:], strict=False):
            left, right = max(float(left), begin), min(float(right), end)
            if right > left:
                colour = STATES[str(verdict.state)]
                axes.barh(row, right - left, 0.72, left, color=colour, ec="white", lw=1)
                words = str(verdict.reason or verdict.state)
                if verdict.state is State.SUSPECT:
                    words = "suspect"
                if (right - left) / (end - begin) > 0.011 * len(words) + 0.01:
                    dark = verdict.state is State.FAULTY
                    axes.text(
                        0.5 * (left + right), row, words, ha="center", va="center",
                        fontsize=8, color="white" if dark else "black",
                    )  # fmt: skip
    axes.set(yticks=range(len(sensors)), yticklabels=list(reversed(sensors)))
    axes.set(ylim=(-0.6, len(sensors) - 0.4), xlim=(begin, end))
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)


def _readings(axes: Axes, flight: Judged, begin: float, end: float) -> None:
    """What both pitots show, and the truth."""
    for sensor, colour in (("airspeed0", OTHER), ("airspeed1", MEASURED)):
        t, cas = flight.rows(sensor, "cas_m_s")
        inside = (t >= begin) & (t <= end)
        axes.plot(t[inside], cas[inside], color=colour, lw=1, label=f"{sensor} reads")
    t, cas = flight.truth("cas_m_s")
    inside = (t >= begin) & (t <= end)
    axes.plot(t[inside], cas[inside], color=TRUE, lw=1, ls="--", label="true")
    axes.set(ylabel="CAS [m/s]", xlim=(begin, end))


def _expected(axes: Axes, flight: Judged, sensor: str, begin: float, end: float) -> None:
    """What a pitot should show, with two standard deviations."""
    t, cas = flight.estimate("air_expected", f"{sensor}_m_s")
    _, std = flight.estimate("air_expected", f"{sensor}_std_m_s")
    inside = (t >= begin) & (t <= end)
    t, cas, std = t[inside], cas[inside], std[inside]
    axes.fill_between(t, cas - 2 * std, cas + 2 * std, color=RECONSTRUCTED, alpha=0.25, lw=0)
    axes.plot(t, cas, color=RECONSTRUCTED, label="expected of it, 2 sigma")


def _ratio(axes: Axes, flight: Judged, sensor: str, begin: float, end: float) -> None:
    """The largest statistic over its threshold, and the threshold."""
    t, ratio = flight.estimate("air_tests", f"{sensor}_ratio")
    inside = (t >= begin) & (t <= end)
    axes.plot(t[inside], np.maximum(ratio[inside], 0.01), color=MEASURED, lw=1)
    axes.axhline(1.0, color=TRUE, lw=0.8)
    axes.set(yscale="log", ylim=(0.01, 90), xlim=(begin, end), yticks=[0.01, 0.1, 1, 10])
    axes.set(yticklabels=["0.01", "0.1", "1", "10"])


def flight(path: Path) -> None:
    """The whole flight: readings above, states below."""
    it = judged(FLIGHT, weigh=True)
    end = float(it.truth("cas_m_s")[0][-1])
    figure, (readings, states) = canvas(4.2, 2, height_ratios=[3, 1], sharex=True)
    for fault in it.faults:
        states.axvspan(fault["onset_s"], fault["cleared_s"] or end, color=FAULT, lw=0)
        readings.axvspan(fault["onset_s"], fault["cleared_s"] or end, color=FAULT, lw=0)
    _readings(readings, it, 0.0, end)
    readings.legend(loc="lower left", bbox_to_anchor=(0.14, 0.03))
    _strip(states, it, ["airspeed0", "airspeed1"], 0.0, end)
    states.set_xlabel("seconds from the log's first record")
    save(figure, path)


def evidence(path: Path) -> None:
    """The static tube of airspeed1 is closed in a descent: explanations compete until one leads."""
    it = judged(FLIGHT, weigh=True)
    fault = it.fault("airspeed1")
    begin, end = fault["onset_s"] - 7.0, fault["detected_s"] + 6.0
    figure, axes = canvas(8.2, 4, height_ratios=[3, 3, 2.2, 1.1], sharex=True)
    readings, candidates, lead, states = axes
    for axis in axes:
        axis.axvline(fault["onset_s"], color=GREY, lw=0.8, ls=":")
        axis.axvline(fault["detected_s"], color=MEASURED, lw=0.8, ls=":")
    _expected(readings, it, "airspeed1", begin, end)
    _readings(readings, it, begin, end)
    readings.legend(loc="upper left")
    readings.set_title("1  what it reads, and what it should read")

    t, L = it.bank["t_s"], np.maximum(it.bank["evidence"], -30.0)
    inside = (t >= begin) & (t < fault["detected_s"] - 0.1)
    for mask, name, colour, line in EXPLANATIONS:
        candidates.plot(t[inside], L[inside, mask], color=colour, ls=line, label=name)
    candidates.legend(loc="upper left")
    candidates.set(ylabel="log-likelihood over\n“nothing happened” [nat]")
    candidates.set_title("2  how well each explanation fits what was measured since")

    margin = load("small-uav").air.margin_one
    others = np.maximum(np.max(L[:, [0, 1]], axis=1), 0.0)
    having = np.max(L[:, [2, 3]], axis=1)
    lead.plot(t[inside], (having - others)[inside], color=MEASURED)
    lead.axhline(margin, color=TRUE, lw=0.8)
    lead.annotate(
        f"margin_one = {margin:g}", (begin, margin), xytext=(4, 4), textcoords="offset points"
    )
    lead.annotate(
        "held for 1 s: FAULTY", (fault["detected_s"], margin), xytext=(5, -22),
        textcoords="offset points", color=MEASURED,
    )  # fmt: skip
    lead.set(ylabel="lead [nat]", ylim=(-12, 14))
    lead.set_title("3  the best that blames airspeed1, over the best that does not")
    _strip(states, it, ["airspeed0", "airspeed1"], begin, end)
    states.set_xlabel("seconds from the log's first record")
    save(figure, path)


def ratio(path: Path) -> None:
    """The pitot of airspeed0 fills with water and drains: alarm, latch, return."""
    it = judged(FLIGHT, weigh=True)
    fault = it.fault("airspeed0")
    begin, end = fault["onset_s"] - 8.0, fault["cleared_s"] + 6.0
    figure, axes = canvas(6.4, 3, height_ratios=[3, 3, 1.1], sharex=True)
    readings, ratios, states = axes
    for axis in axes:
        axis.axvline(fault["detected_s"], color=MEASURED, lw=0.8, ls=":")
        axis.axvline(fault["cleared_s"], color=OTHER, lw=0.8, ls=":")
    _expected(readings, it, "airspeed0", begin, end)
    t, cas = it.rows("airspeed0", "cas_m_s")
    inside = (t >= begin) & (t <= end)
    readings.plot(t[inside], cas[inside], color=MEASURED, lw=1, label="airspeed0 reads")
    t, cas = it.truth("cas_m_s")
    inside = (t >= begin) & (t <= end)
    readings.plot(t[inside], cas[inside], color=TRUE, lw=1, ls="--", label="true")
    readings.set(ylabel="CAS [m/s]")
    readings.legend(loc="center", bbox_to_anchor=(0.36, 0.5))
    _ratio(ratios, it, "airspeed0", begin, end)
    ratios.set(ylabel="statistic / threshold")
    split = fault["detected_s"]
    for words, x, side in (("accuses", -5, "right"), ("keeps it from returning", 5, "left")):
        ratios.annotate(
            words, (split, 55.0), xytext=(x, 0), ha=side, textcoords="offset points", fontsize=9.5
        )
    _strip(states, it, ["airspeed0", "airspeed1"], begin, end)
    states.set_xlabel("seconds from the log's first record")
    save(figure, path)
