"""Pictures of ``estimators/air*.md``: what a turn teaches, and what bounds on the wind are for."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.patches import Ellipse

from drawing.flights import Judged, judged
from drawing.style import GREY, MEASURED, OTHER, RECONSTRUCTED, TRUE, canvas, save
from estimators.air_data_3d import SCALE
from monitor.commands.reproduce.study import Job
from monitor.commands.reproduce.wan2018 import runaway
from monitor.settings import load

FLIGHT: Final = "small-uav-pitot-blockage"
K0: Final = SCALE.start
ICING_S: Final = 120.0
STRAIGHT_S: Final = 56.0
"""Before the first turn of the flight, which begins a second later."""


def turn(path: Path) -> None:
    """A straight leaves wind and scale tied together, the first turn unties them."""
    it = judged(FLIGHT, weigh=True)
    t, x, P = it.bank["t_s"], it.bank["x"], it.bank["P"]
    learnt_std = load("small-uav").air.learnt_scale_std
    learnt_s = next(v.t_us for v in it.verdicts("airspeed0") if str(v.state) == "ok")
    learnt_s = float(it.seconds(np.array(learnt_s)))
    figure, (ridge, spread, bank) = canvas(8.0, 3, height_ratios=[3.4, 2.4, 1.2])

    _, euler = it.truth("euler_rad")
    t_true, wind = it.truth("wind_ned_m_s")
    at = int(np.searchsorted(t_true, STRAIGHT_S))
    nose = np.array([math.cos(euler[at, 2]), math.sin(euler[at, 2])])
    for when, colour, name in (
        (STRAIGHT_S, MEASURED, f"on the straight, {STRAIGHT_S:.0f} s"),
        (learnt_s, OTHER, f"in the turn, {learnt_s:.0f} s"),
    ):
        i = int(np.searchsorted(t, when))
        rows = np.zeros((2, x.shape[1]))
        rows[0, :2], rows[1, K0] = nose, 100.0
        centre, C = rows @ x[i], rows @ P[i] @ rows.T
        lengths, axes = np.linalg.eigh(C)
        for sigmas in (1.0, 2.0):
            width, height = 2.0 * sigmas * np.sqrt(lengths)
            ridge.add_patch(
                Ellipse(
                    tuple(centre), width, height,
                    angle=math.degrees(math.atan2(axes[1, 0], axes[0, 0])),
                    fc=colour, alpha=0.25, ec=colour, label=name if sigmas == 1.0 else None,
                )
            )  # fmt: skip
    mean = wind[(t_true > STRAIGHT_S - 10) & (t_true < learnt_s)].mean(axis=0)
    ridge.plot(mean[:2] @ nose, 0.0, "x", color=TRUE, ms=9, mew=2, label="truth")
    ridge.set(xlabel="wind along the nose of the straight [m/s]", ylabel="pitot reads low by [%]")
    ridge.legend(loc="best")
    ridge.autoscale_view()
    ridge.margins(0.08)
    ridge.set_title("what is known of wind and scale together, 1 and 2 sigma")

    inside = (t > 32.0) & (t < 100.0)
    spread.plot(t[inside], 100.0 * np.sqrt(P[inside, K0, K0]), color=RECONSTRUCTED)
    spread.axhline(100.0 * learnt_std, color=TRUE, lw=0.8)
    spread.annotate(
        f"learnt_scale_std = {learnt_std:g}", (100.0, 100.0 * learnt_std), xytext=(0, 4),
        ha="right", textcoords="offset points",
    )  # fmt: skip
    spread.axvline(learnt_s, color=OTHER, ls=":")
    spread.set(ylabel="deviation of\nthe scale [%]", ylim=(0, None), xlim=(32, 100))
    spread.annotate("learning", (learnt_s, 1.0), xytext=(-6, 0), ha="right",
                    textcoords="offset points", color=GREY)  # fmt: skip
    spread.annotate("ok", (learnt_s, 1.0), xytext=(6, 0), textcoords="offset points", color=OTHER)
    inside = (t_true > 32.0) & (t_true < 100.0)
    bank.plot(t_true[inside], np.degrees(euler[inside, 0]), color=GREY)
    bank.axvline(learnt_s, color=OTHER, ls=":")
    bank.set(xlabel="seconds from the log's first record", ylabel="bank [°]", xlim=(32, 100))
    save(figure, path)


def bounds(path: Path) -> None:
    """Three airspeeds run away together: without bounds it is a wind, with them a fault."""
    course = runaway.work(Job("wan2018", "runaway/fig4", {"seeds": 1}, 0))["course"]
    kt = 0.514444
    figure, (readings, winds, residuals) = canvas(6.6, 3, sharex=True)
    t = course["t_s"]
    inside = (t > 16.0) & (t < 40.0)
    readings.plot(t[inside], kt * course["cas_kt"][inside, 0], color=MEASURED, lw=1,
                  label="each of the three reads")  # fmt: skip
    readings.plot(t[inside], kt * course["cas_true_kt"][inside], color=TRUE, ls="--", label="true")
    readings.set(ylabel="CAS [m/s]")
    readings.legend(loc="lower left")
    for method, colour, name in (
        ("UMHE", GREY, "no bounds"),
        ("CMHE", OTHER, "bounds, as printed"),
        ("ours", RECONSTRUCTED, "bounds, band, latch and memory"),
    ):
        winds.plot(t[inside], kt * course[method]["wind_kt"][inside], color=colour, label=name)
        J = kt * course[method]["J_kt"].max(axis=1)
        residuals.plot(t[inside], J[inside], color=colour)
    winds.plot(t[inside], kt * course["wind_kt"][inside], color=TRUE, ls="--", label="true")
    winds.axhline(kt * runaway.BOUND_KT, color=TRUE, lw=0.8)
    winds.annotate("bound", (16.2, kt * runaway.BOUND_KT), xytext=(0, 3),
                   textcoords="offset points")  # fmt: skip
    winds.set(ylabel="wind $W_x$ [m/s]", ylim=(-5, 110))
    winds.legend(loc="lower right", ncols=2)
    residuals.axhline(kt * runaway.THRESHOLD_KT, color=TRUE, lw=0.8)
    residuals.annotate("threshold", (16.2, kt * runaway.THRESHOLD_KT), xytext=(0, 3),
                       textcoords="offset points")  # fmt: skip
    residuals.set(ylabel="residual J [m/s]", ylim=(0, 30), xlabel="time [s]")
    save(figure, path)


def _icing(table: dict[str, Any]) -> None:
    """Leaves the small aircraft one pitot, which loses 5 % a minute while it flies in squares."""
    table["airspeed"]["count"] = 1
    square = [
        {"do": "turn", "angle_deg": 90.0, "bank_deg": 30.0},
        {"do": "level", "duration_s": 30.0},
    ]
    table["leg"] = table["leg"][:5] + 9 * square
    icing = {"kind": "icing", "start_s": ICING_S, "fraction_per_s": 0.05 / 60.0}
    table["fault"] = [{"sensor": "airspeed0"} | icing]


def drift(path: Path) -> None:
    """A lone pitot ices: the filters follow it, the long horizon finds it."""
    it = judged(FLIGHT, "small-uav", _icing)
    fault = it.fault("airspeed0")
    begin, end = 70.0, fault["detected_s"] + 40.0
    figure, (error, ratios) = canvas(5.2, 2, height_ratios=[3, 2], sharex=True)
    t_true, true = it.truth("cas_m_s")
    for (t, cas), colour, name, width in (
        (it.rows("airspeed0", "cas_m_s"), MEASURED, "airspeed0 reads", 0.6),
        (it.estimate("air_expected", "airspeed0_m_s"), RECONSTRUCTED, "expected of it", 1.2),
    ):
        inside = (t > begin) & (t < end)
        off = 100.0 * (cas[inside] / np.interp(t[inside], t_true, true) - 1.0)
        error.plot(t[inside], off, color=colour, lw=width, label=name)
    error.axvline(ICING_S, color=GREY, lw=0.8, ls=":")
    error.set(ylabel="off the true CAS by [%]", ylim=(-26, 4))
    error.legend(loc="lower left")
    t, ratio = it.estimate("air_tests", "airspeed0_ratio")
    inside = (t > begin) & (t < fault["detected_s"] + 0.1)
    ratios.plot(t[inside], ratio[inside], color=MEASURED, lw=1)
    ratios.axhline(1.0, color=TRUE, lw=0.8)
    for axes in (error, ratios):
        axes.axvline(fault["detected_s"], color=MEASURED, lw=0.8, ls=":")
        axes.set_xlim(begin, end)
    ratios.annotate("faulty", (fault["detected_s"], 1.6), xytext=(4, 0), color=MEASURED,
                    textcoords="offset points")  # fmt: skip
    ratios.set(ylabel="statistic / threshold", ylim=(0, 2))
    ratios.set_xlabel("seconds from the log's first record")
    save(figure, path)


@cache
def lone_vane(size_deg: float) -> Judged:
    """The light aircraft with one vane, which is off by so much for half a minute."""

    def change(table: dict[str, Any]) -> None:
        table["aoa"]["count"] = 1
        fault = {"sensor": "aoa0", "kind": "bias", "size_deg": size_deg}
        table["fault"] = [fault | {"start_s": 130.0, "end_s": 160.0}]

    return judged("light-aircraft-vane", "light-aircraft", change)


def vane(path: Path) -> None:
    """Two shifts of a lone vane: one that an updraft would explain, and one that none would."""
    figure, (off, ratios) = canvas(5.6, 2, height_ratios=[3, 2], sharex=True)
    begin, end = 120.0, 185.0
    limits = load("light-aircraft").vane
    for size_deg, colour in ((3.0, OTHER), (4.5, MEASURED)):
        it = lone_vane(size_deg)
        t, aoa = it.rows("aoa0", "aoa_rad")
        expected = np.interp(t, *it.estimate("air_expected", "aoa0_rad"))
        inside = (t > begin) & (t < end)
        off.plot(t[inside], np.degrees(aoa - expected)[inside], color=colour, lw=0.8,
                 label=f"off by {size_deg:g}° from 130 to 160 s")  # fmt: skip
        t_tests, ratio = it.estimate("air_tests", "aoa0_ratio")
        inside = (t_tests > begin) & (t_tests < end)
        ratios.plot(t_tests[inside], ratio[inside], color=colour)
        for verdict in it.verdicts("aoa0"):
            at = float(it.seconds(np.array(verdict.t_us)))
            if begin < at < end:
                ratios.axvline(at, color=colour, lw=0.8, ls=":")
                ratios.annotate(str(verdict.state), (at, 2.7), xytext=(4, 0), color=colour,
                                textcoords="offset points")  # fmt: skip
    t_air, tas = it.estimate("air", "tas_m_s")
    during = (t_air > begin) & (t_air < end)
    least = np.degrees(np.arctan(limits.updraft_m_s / tas[during]))
    before = float(np.degrees(aoa - expected)[(t > begin) & (t < 130.0)].mean())
    words = f"as before, within an updraft of {limits.updraft_m_s:g} m/s"
    off.fill_between(
        t_air[during], before - least, before + least, color=GREY, alpha=0.2, lw=0, label=words
    )
    off.set(ylabel="vane less expected [°]", xlim=(begin, end), ylim=(-6, 10))
    off.legend(loc="upper left")
    ratios.axhline(1.0, color=TRUE, lw=0.8)
    ratios.set(ylabel="statistic / threshold", ylim=(0, 3))
    ratios.set_xlabel("seconds from the log's first record")
    save(figure, path)
