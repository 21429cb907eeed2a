"""What lu2016 section 5 says of recorded flights, against ours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import degrees
from typing import Final

import numpy as np

from monitor.commands.reproduce.lu2016.published import AXES, PARABOLIC_GYRO_RAD_S
from monitor.commands.reproduce.lu2016.recorded_names import (
    FOLLOWED,
    FORMS,
    MENDED,
    OWN_TIMES,
    OWN_TIMES_SLOW,
    PAPER,
    PAPER_FAST,
    flights_of,
    median_of,
    overall,
    spread,
    swing,
)
from monitor.commands.reproduce.study import Claim, Result, Scope, decided

__all__ = ["claims"]

FOLLOWS: Final = 0.25
"""A reconstruction whose late error is a smaller share of the fault follows it."""
ROBUST: Final = 1.5
"""Largest over smallest RMSE of flights in which a method does the same."""


def claims(results: Mapping[str, Result], scope: Scope) -> list[Claim]:
    """Section 5; "not run" without recordings."""
    flights = flights_of(results)
    if not flights:
        because = "No recordings were given; the synthetic recordings stand in for them."
        return [Claim("Section 5: validation on recorded flights.", "not run", because)]
    return [
        _follow(flights),
        _zero_mean(flights),
        _residuals(flights),
        _largest_rate_error(flights),
        _robust(flights),
        _faster(flights),
        Claim(
            "Section 5, Figs. 9-12: on real flights the ground-speed model beats the airspeed "
            "model.",
            "not reproducible",
            "The recordings have no vane and no sideslip, so that the airspeed model cannot be run "
            "on them; the synthetic recordings have both.",
        ),
    ]


def _follow(flights: Sequence[Result]) -> Claim:
    share = overall(flights, PAPER, "share_late")
    good = share < FOLLOWS
    told = ", ".join(f"{a} {100 * s:.0f} %" for a, s in zip(AXES, share, strict=True))
    best = min(float(overall(flights, form, "share_late")[4]) for form in FORMS)
    noise = degrees(max(r["flight"]["noise"][3] for r in flights))
    out, delay_s = swing(flights, PAPER)
    mended, sooner_s = overall(flights, MENDED, "share_late"), swing(flights, MENDED)[1]
    reason = (
        ""
        if good.all()
        else f" The oscillation of f_Az comes out at {100 * out:.0f} % of its size and "
        f"{delay_s:.1f} s late. What (53) subtracts as noise, motion between the samples of a "
        f"10 Hz IMU of up to {noise:.1f} deg/s in roll, and divides by dt, hides f_p from the "
        "adaptation, and the dt² of (57) slows it: without these two, f_p is wrong by "
        f"{100 * mended[3]:.0f} % and f_Az {sooner_s:.1f} s late. f_q swings the attitude by 0.6 "
        f"deg; no form is wrong by less than {100 * best:.0f} % of it."
    )
    return Claim(
        "Section 5.1, on our recordings: the estimates follow the faults that were written into "
        "real flights.",
        decided(bool(good.all()), bool(good.any())),
        f"From 5 s after the onset the rms error is, of the fault: {told}.{reason}",
    )


def _zero_mean(flights: Sequence[Result]) -> Claim:
    means = np.abs([r["healthy"][PAPER]["mean"] for r in flights])
    stds = np.array([r["healthy"][PAPER]["std"] for r in flights])
    acc, gyro = means[:, :3].max(), degrees(means[:, 3:].max())
    ratio = means / stds
    return Claim(
        "Sections 5.1 and 5.2, on our recordings: the estimation errors are zero-mean.",
        decided(bool((ratio < 1.0).all()), bool((ratio < 1.0).mean() > 0.75)),
        f"Of healthy recordings the estimates have means of up to {acc:.2f} m/s² and "
        f"{gyro:.2f} deg/s, {ratio.max():.0f} times their deviation: turn-on biases of a small "
        "IMU, which are faults to the filter and none to its owner. A monitor has to judge "
        "changes.",
    )


def _residuals(flights: Sequence[Result]) -> Claim:
    """The paper takes small residuals for a proof of unbiased states."""
    ratio = []
    for r in flights:
        before, during = (median_of(r, PAPER, k) for k in ("residual_before", "residual_during"))
        ratio.append(during / before)
    worst = np.max(ratio, axis=0)
    own, followed = (overall(flights, f, "residual_during") for f in (PAPER, FOLLOWED))
    alike = float(np.max(followed / own))
    wrong = abs(float(overall(flights, FOLLOWED, "bias_late")[0]))
    small = bool((worst < 2.0).all())
    proof = alike > 2.0
    return Claim(
        "Section 5.1, Fig. 8, on our recordings: measured and estimated states differ little even "
        "under faults, which demonstrates unbiased estimates.",
        decided(small and proof, small or bool((worst < 2.0).any())),
        f"Under faults the residuals grow at most {worst.max():.1f} times. "
        + ("" if proof else "They demonstrate nothing, though: ")
        + "with an attitude that follows the broken IMU they are at most "
        f"{alike:.1f} times as large while f_Ax is wrong by {wrong:.1f} of 3 m/s².",
    )


def _largest_rate_error(flights: Sequence[Result]) -> Claim:
    agile = max(flights, key=lambda r: r["flight"]["roll_rate_deg_s"])
    most = float(np.max(median_of(agile, PAPER, "largest")[3:]))
    late = float(np.max(median_of(agile, PAPER, "rmse_late")[3:]))
    return Claim(
        "Section 5.2, on our most agile recording: the largest error of a rate fault is below "
        "0.05 rad/s, even as the faults set in.",
        decided(most < PARABOLIC_GYRO_RAD_S, most < 1.2 * PARABOLIC_GYRO_RAD_S),
        f"{most:.3f} rad/s at the onset of f_r, which is 0.052 rad/s itself, on the recording with "
        f"{agile['flight']['roll_rate_deg_s']:.0f} deg/s of roll; {late:.3f} rad/s rms from 5 s "
        "after the onset on.",
    )


def _robust(flights: Sequence[Result]) -> Claim:
    ratio = spread(flights, PAPER)
    told = ", ".join(f"{a} {v:.2f}" for a, v in zip(AXES, ratio, strict=True))
    return Claim(
        "Section 5.4, Fig. 12, on our recordings: with the ground-speed model the performance does "
        "not change significantly with the flight.",
        decided(bool((ratio < ROBUST).all()), bool(ratio[0] < ROBUST)),
        f"Largest over smallest RMSE of {len(flights)} recordings: {told}.",
    )


def _faster(flights: Sequence[Result]) -> Claim:
    gains = {
        name: overall(flights, fast, "rmse")[:3] / overall(flights, slow, "rmse")[:3]
        for name, fast, slow in (
            ("interpolated", PAPER_FAST, PAPER),
            ("at their own times", OWN_TIMES, OWN_TIMES_SLOW),
        )
    }
    good = [bool((g < 1.0).all()) for g in gains.values()]
    told = "; ".join(
        f"{name}: " + ", ".join(f"{a} {v:.2f}" for a, v in zip(AXES[:3], g, strict=True))
        for name, g in gains.items()
    )
    return Claim(
        "Section 5.4, on our recordings: ground speed at a higher rate than 1 Hz gives a better "
        "performance.",
        decided(all(good), any(good)),
        f"RMSE with GPS at 5 Hz over that at 1 Hz, {told}. Interpolation off line looks ahead to "
        "the next fix, which makes up for most of a slow receiver.",
    )
