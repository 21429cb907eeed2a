"""What lu2016 sections 3.2 and 3.3 say of the two loops, against ours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from monitor.commands.reproduce.lu2016.closed_loop_names import (
    AIR,
    ANGLE_RAD,
    EXACT,
    FAULTY,
    FLOWN,
    GROUND,
    VELOCITY_M_S,
    change_of,
    deviations,
    draws_of,
    median_of,
    steered_on,
    winds_of,
)
from monitor.commands.reproduce.lu2016.published import AXES, shown
from monitor.commands.reproduce.study import Claim, Result, Scope, decided

__all__ = ["claims"]

SAME: Final = 0.02
"""Two RMSE that differ by less than this share are the same."""
CLOSE: Final = 0.1
"""Estimates whose rms difference is a smaller share of their error than this match closely."""


def claims(results: Mapping[str, Result], scope: Scope) -> list[Claim]:
    """What sections 3.2 and 3.3 say."""
    winds = winds_of(results)
    if not winds:
        return []
    calm = draws_of(results, winds[0])
    return [
        _claim_states(calm),
        _claim_estimates(calm),
        _claim_edges(calm),
        _claim_after(calm),
        _claim_open_is_valid(results, winds),
        _claim_tolerant(results, winds),
    ]


def _claim_states(rows: Sequence[Result]) -> Claim:
    most = median_of(rows, GROUND, "state_max")
    exact = median_of(rows, EXACT, "state_max")
    bias = [abs(float(shown(median_of(rows, n, "bias_closed"))[4])) for n in (GROUND, EXACT)]
    good = [most[:3].max() < VELOCITY_M_S, most[3:].max() < ANGLE_RAD]
    near = bool(most[:3].max() < 5 * VELOCITY_M_S and most[3:].max() < 5 * ANGLE_RAD)
    return Claim(
        "Section 3.3, Fig. 3(a, b): the true velocities of the two loops differ by less than "
        "0.2 m/s, the angles by less than 5e-3 rad.",
        decided(all(good), near),
        f"{most[:3].max():.2f} m/s and {1e3 * most[3:].max():.1f} mrad with our aircraft "
        f"({exact[:3].max():.2f} m/s and {1e3 * exact[3:].max():.1f} mrad when the filter is "
        "linearised at x, which takes the mean error of f_q during the faults from "
        f"{bias[0]:.4f} to {bias[1]:.4f} deg/s). Our autopilot holds no heading, and heading "
        "integrates such errors.",
    )


def _claim_estimates(rows: Sequence[Result]) -> Claim:
    share = median_of(rows, GROUND, "difference_rms") / median_of(rows, GROUND, "rmse_closed")
    change = change_of(rows, GROUND)
    return Claim(
        "Section 3.3, Fig. 3(c, d): the fault estimates of both loops closely match each other.",
        decided(bool(share.max() < CLOSE), bool(share.max() < 0.5)),
        f"Their rms difference is at most {100 * share.max():.1f} % of their error on any axis, "
        f"and closing the loop changes no RMSE by more than {100 * change:.1f} %.",
    )


def _claim_edges(rows: Sequence[Result]) -> Claim:
    steady = [0, 1, 3, 5]  # all but the two oscillations
    share = median_of(rows, GROUND, "edge_share")[steady]
    time = float(np.median([r["filters"][GROUND]["edge_time_share"] for r in rows]))
    axes = ", ".join(f"{AXES[k]} {100 * s:.0f} %" for k, s in zip(steady, share, strict=True))
    good = share > 0.5
    return Claim(
        "Section 3.3, Fig. 3(e, f): the estimates differ mainly at the beginning and the end of "
        "the faults, but for the oscillating f_Az and f_q.",
        decided(bool(good.all()), bool(good.any())),
        f"Of the squared differences, the 2 s after onset and end ({100 * time:.0f} % of the "
        f"time) hold {axes}.",
    )


def _claim_after(rows: Sequence[Result]) -> Claim:
    means = np.abs(median_of(rows, GROUND, "quiet_mean_closed"))
    std = median_of(rows, GROUND, "quiet_std_closed")
    opened = np.abs(median_of(rows, GROUND, "quiet_mean_open"))
    ratio = float(np.max(np.maximum(means, opened) / std))
    apart = median_of(rows, GROUND, "state_max")[:3].max()
    return Claim(
        "Section 3.3: after the faults the flights still differ, yet both loops' fault estimates "
        "have zero mean.",
        decided(ratio < 0.5, ratio < 1.0),
        f"With flights up to {apart:.2f} m/s apart, no mean after 32 s exceeds {ratio:.2f} of the "
        "estimate's own standard deviation.",
    )


def _claim_open_is_valid(results: Mapping[str, Result], winds: Sequence[str]) -> Claim:
    ground = max(change_of(draws_of(results, w), GROUND) for w in winds)
    air = max(change_of(draws_of(results, w), AIR, 3) for w in winds)
    worst = max(float(median_of(draws_of(results, w), AIR, "rmse_open")[:3].max()) for w in winds)
    same = ground < SAME
    note = (
        "Good estimates are sufficient, not necessary: the airspeed model is off by up to "
        f"{worst:.1f} m/s² RMS in wind and still has the same errors within {100 * air:.1f} % in "
        "both loops, as they come from the wind and not from the faults."
        if air < SAME and worst > 1.0
        else f"The airspeed model, off by up to {worst:.1f} m/s², changes by {100 * air:.1f} %."
    )
    return Claim(
        "Sections 3.2 and 3.3: with unbiased estimates, open-loop validation is as valid as "
        "closed-loop validation.",
        decided(same, ground < 0.1),
        f"On the ground-speed model closing the loop changes no RMSE by more than "
        f"{100 * ground:.1f} % in {', '.join(winds)}. {note}",
    )


def _claim_tolerant(results: Mapping[str, Result], winds: Sequence[str]) -> Claim:
    """Fault-tolerant control: section 3.2, around (60)."""
    worst = []
    for wind in winds:
        rows = draws_of(results, wind)
        fixed, faulty = (deviations(rows, fed) for fed in (steered_on(GROUND), FAULTY))
        worst.append(float(np.max(fixed / faulty)))
    rows = draws_of(results, winds[0])
    fixed, faulty = (deviations(rows, fed) for fed in (steered_on(GROUND), FAULTY))
    return Claim(
        "Section 3.2: steering on the reconstructed values achieves fault-tolerant control.",
        decided(max(worst) < 0.35, max(worst) < 1.0),
        f"In calm air the flight parts from the one on true values by {fixed[0]:.1f} m of height, "
        f"{fixed[1]:.2f} m/s of airspeed and {fixed[4]:.1f} deg of heading, against "
        f"{faulty[0]:.1f} m, {faulty[1]:.2f} m/s and {faulty[4]:.1f} deg on the faulty ones; in "
        f"all winds the worst quantity keeps {100 * max(worst):.0f} % of the faulty deviation. "
        + _on_the_air(results, winds),
    )


def _on_the_air(results: Mapping[str, Result], winds: Sequence[str]) -> str:
    """How the airspeed model's reconstruction steers, where it does worst."""
    worse: dict[str, list[str]] = {}
    for wind in winds:
        rows = draws_of(results, wind)
        fixed, faulty = (deviations(rows, fed) for fed in (steered_on(AIR), FAULTY))
        names = [name.partition(" [")[0] for name in FLOWN]
        worse[wind] = [n for n, a, b in zip(names, fixed, faulty, strict=True) if a >= b]
    wind = max(worse, key=lambda w: len(worse[w]))
    if not worse[wind]:
        return "The airspeed model's reconstruction, too, is better than none in every quantity."
    return (
        f"On the airspeed model it does not: in {wind} {', '.join(worse[wind])} part further than "
        "on the faulty readings themselves."
    )
