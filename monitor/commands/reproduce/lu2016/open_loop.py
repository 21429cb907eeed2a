"""lu2016 section 5 on synthetic recordings: level, parabolic, turbulent; faults written in after.

The receiver gives the ground speed at 1 Hz; as in the paper it is interpolated linearly. What
that alone costs is shown beside it, with receivers of 5 and 100 Hz and with samples used as they
come.
"""

from __future__ import annotations

from math import degrees, radians
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from estimators.kinematics import AS, GS
from monitor.commands.reproduce.lu2016.methods import (
    PRINTED,
    Noise,
    all_estimates,
    scores,
    two_stage,
)
from monitor.commands.reproduce.lu2016.open_loop_shown import (
    FASTER_HZ,
    SHOWN_MODELS,
    blocks,
    both,
    flights_of,
    of,
)
from monitor.commands.reproduce.lu2016.published import (
    AXES,
    LEVEL_RATIO,
    PARABOLIC_GYRO_RAD_S,
)
from monitor.commands.reproduce.lu2016.simulated import graded
from monitor.commands.reproduce.study import Claim, Job, Result, Results, Scope

if TYPE_CHECKING:
    from sim_feeds.papers.lu2016_flights import Recording
    from sim_feeds.papers.lu2016_runs import Recorder

__all__ = ["blocks", "claims", "jobs", "work"]

Floats = NDArray[np.float64]

EVERY: Final = 4
FOLLOWED_S: Final = 0.5
"""After an onset or end of faults in which no filter can know yet."""


def jobs(scope: Scope) -> list[Job]:
    """One a flight and draw."""
    from sim_feeds.papers.lu2016_runs import runs

    seeds = [scope.drawn(seed) for seed in runs().open_loop.chosen(scope.quick)]
    return [
        Job(
            "lu2016",
            f"open_loop/{flight.name}/{seed}",
            {"flight": flight.name, "drawn": seed == seeds[0]},
            seed,
        )
        for flight in runs().flight
        for seed in seeds
    ]


def work(job: Job) -> Result:
    """Errors with both models, with other receivers, and the lines of the first draw."""
    from sim_feeds.papers.lu2016_flights import record
    from sim_feeds.papers.lu2016_runs import runs

    name, recorder = job.what["flight"], runs().recorder
    recording = record(name, job.seed)
    flight, noise = recording.flight, _noise(recorder)
    estimates = {
        f"{name}/{method}": f
        for name, model, y in (("GS", GS, flight.y_ground), ("AS", AS, flight.y_air))
        for method, f in all_estimates(flight, model, y, noise).items()
    }
    estimates["as they come"] = two_stage(flight, GS, recording.y_sparse, noise)["f"]
    found: dict[str, Any] = dict(scores(estimates, flight))
    ours = found["GS/atsekf"]
    ours["followed"] = _largest_once_followed(estimates["GS/atsekf"], flight.f[1:], flight.t_s[1:])
    for hz in FASTER_HZ:
        faster = record(name, job.seed, recorder=recorder.model_copy(update={"gps_hz": hz})).flight
        track = two_stage(faster, GS, faster.y_ground, noise, **PRINTED)
        found[f"GS at {hz:g} Hz"] = scores({"": track["f"]}, faster)[""]
    if job.what["drawn"]:
        state = two_stage(flight, GS, flight.y_ground, noise, **PRINTED)["x"]
        found["lines"] = _lines(recording, estimates, state)
    return found


def _noise(r: Recorder) -> Noise:
    """What the filters are told: the white noise of the recorder's data sheet, no bias, no vane."""
    return Noise(
        acc=r.acc_std_m_s2,
        gyro=radians(r.gyro_std_deg_s),
        velocity=r.gps_std_m_s,
        angles=radians(r.attitude_std_deg),
        tas=r.tas_std_m_s,
        vane=radians(r.vane_std_deg),
    )


def _largest_once_followed(estimate: Floats, f: Floats, t_s: Floats) -> Floats:
    """Largest errors without the half second after each jump of a fault, (6,)."""
    jumps = t_s[1:][np.any(np.abs(np.diff(f, axis=0)) > np.array([0.2] * 3 + [0.01] * 3), axis=1)]
    fresh = np.zeros(len(t_s), dtype=bool)
    for jump in jumps:
        fresh |= (t_s >= jump) & (t_s < jump + FOLLOWED_S)
    return np.asarray(np.abs(estimate - f)[~fresh].max(axis=0))


def _lines(recording: Recording, estimates: dict[str, Floats], state: Floats) -> dict[str, Any]:
    flight, truth = recording.flight, recording.truth
    late = slice(1, None, EVERY)
    flown = np.column_stack(
        [
            truth.height_m,
            truth.tas_m_s,
            np.degrees(truth.aoa_rad),
            truth.specific_force_m_s2[:, 2],
        ]
    )
    return {
        "t_s": flight.t_s[late],
        "f": flight.f[late],
        "flown": flown[late],
        "measured": flight.y_ground[late],
        "state": state[::EVERY],
        **{model: estimates[f"{model}/atsekf"][::EVERY] for model in SHOWN_MODELS},
    }


def claims(results: Results, scope: Scope) -> list[Claim]:
    """What section 5 says of the three flights."""
    level, parabolic, turbulent = (
        both(results, name) for name in ("level", "parabolic", "turbulent")
    )
    return [
        _level(level),
        _parabola(results, parabolic),
        _before_the_faults(results),
        _gyros(results),
        _turbulence(turbulent),
        _f_ax(level, parabolic, turbulent),
        _observer(results),
    ]


def _ratios(rmse: dict[str, Floats]) -> Floats:
    """Airspeed over ground-speed model."""
    return np.asarray(rmse["AS"] / rmse["GS"])


def _level(rmse: dict[str, Floats]) -> Claim:
    ratio = _ratios(rmse)
    others = np.delete(ratio, 2)
    twice = 0.75 * LEVEL_RATIO < ratio[2] < 1.25 * LEVEL_RATIO
    return Claim(
        "Section 5.1, level flight: both models do alike, but the airspeed model's RMSE of f_Az is"
        " almost twice the other's.",
        graded([bool(np.all(np.abs(others - 1.0) < 0.25)), twice]),
        f"Airspeed over ground-speed model: f_Az {ratio[2]:.2f} (paper: almost"
        f" {LEVEL_RATIO:g}), f_Ax {ratio[0]:.2f}, f_Ay {ratio[1]:.2f}, gyros"
        f" {ratio[3:].min():.2f} to {ratio[3:].max():.2f}; f_Ay suffers from the noise of the"
        " sideslip vane times the airspeed.",
    )


def _parabola(results: Results, rmse: dict[str, Floats]) -> Claim:
    ratio = _ratios(rmse)[:3]
    fast = of(results, "parabolic", f"GS at {FASTER_HZ[-1]:g} Hz")[:3]
    better = [bool(v > 1.0) for v in ratio]
    words = ", ".join(
        f"{axis} {a:.2f} against {g:.2f}"
        for axis, a, g in zip(AXES[:3], rmse["AS"], rmse["GS"], strict=False)
    )
    return Claim(
        "Section 5.2, parabolic flight: both degrade, the ground-speed model is better.",
        graded(better),
        f"RMSE airspeed against ground-speed model: {words} m/s². Without the interpolation over"
        f" 1 s, from a receiver of {FASTER_HZ[-1]:g} Hz, the latter's are"
        f" {', '.join(f'{v:.2f}' for v in fast)}.",
    )


def _before_the_faults(results: Results) -> Claim:
    air, ground = (
        float(of(results, "parabolic", f"{m}/atsekf", "before")[0]) for m in SHOWN_MODELS
    )
    return Claim(
        "Section 5.2, parabolic flight: f_Ax of the airspeed model is wrong even before the faults,"
        " the ground-speed model's is not.",
        graded([air > 3.0 * ground]),
        f"RMS of the estimate of f_Ax between 3 s and the first fault: {air:.2f} m/s² with the"
        f" airspeed model, {ground:.2f} with the ground-speed model.",
    )


def _gyros(results: Results) -> Claim:
    largest = of(results, "parabolic", "GS/atsekf", "largest")[3:].max()
    followed = of(results, "parabolic", "GS/atsekf", "followed")[3:].max()
    return Claim(
        f"Section 5.2: the largest gyro error is below {PARABOLIC_GYRO_RAD_S:g} rad/s even when the"
        " faults are injected.",
        graded([bool(followed < PARABOLIC_GYRO_RAD_S), bool(largest < PARABOLIC_GYRO_RAD_S)]),
        f"{largest:.4f} rad/s ({degrees(largest):.2f} deg/s) at the sample at which f_r jumps to 3"
        f" deg/s = 0.0524 rad/s, which no filter can know yet; {followed:.4f} rad/s from"
        f" {FOLLOWED_S:g} s after each jump on.",
    )


def _turbulence(rmse: dict[str, Floats]) -> Claim:
    ratio = _ratios(rmse)
    return Claim(
        "Section 5.3, turbulence: the accelerometers' RMSEs of the ground-speed model are"
        " prominently smaller, the gyros' comparable.",
        graded([bool(ratio[:3].min() > 3.0), bool(np.all(np.abs(ratio[3:] - 1.0) < 0.25))]),
        f"Airspeed over ground-speed model: accelerometers {ratio[:3].min():.1f} to"
        f" {ratio[:3].max():.1f}, gyros {ratio[3:].min():.2f} to {ratio[3:].max():.2f}.",
    )


def _f_ax(*flights: dict[str, Floats]) -> Claim:
    air, ground = (np.array([rmse[m][0] for rmse in flights]) for m in SHOWN_MODELS)
    steady = bool(ground.max() < 1.5 * ground.min())
    return Claim(
        "Section 5.4, Fig. 12: over the three flights f_Ax of the ground-speed model does not"
        " change significantly, the airspeed model is worst in turbulence.",
        graded([steady, int(np.argmax(air)) == 2]),
        f"Level, parabolic, turbulent: {', '.join(f'{v:.2f}' for v in ground)} m/s² against"
        f" {', '.join(f'{v:.2f}' for v in air)} m/s².",
    )


def _observer(results: Results) -> Claim:
    flights = flights_of(results)
    ours, low, raw = (
        np.median([of(results, name, f"GS/{m}") for name in flights], axis=0)
        for m in ("atsekf", "smo-low", "smo")
    )

    def told(rmse: Floats) -> str:
        acc, gyro = rmse[:3], np.degrees(rmse[3:])
        return (
            f"{acc.min():.2f} to {acc.max():.2f} m/s², {gyro.min():.2f} to {gyro.max():.2f} deg/s"
        )

    return Claim(
        "Section 3.5: the observer's standard deviations are larger, therefore only the ATSEKF is"
        " used on the recorded flights.",
        graded([bool(np.all(low[part] > ours[part])) for part in (slice(0, 3), slice(3, 6))]),
        f"RMSE on the ground-speed model, median of the flights: ATSEKF {told(ours)}; observer"
        f" {told(raw)} raw, {told(low)} low-passed. A ground speed interpolated over 1 s has no"
        " noise from sample to sample that an observer could magnify.",
    )
