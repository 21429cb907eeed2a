"""Why a figure of ours differs from the paper's, decided by the figures themselves."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from estimators.air_data_mhe import AirDataTuning
from estimators.triplex import TriplexTuning
from monitor.commands.reproduce.study import Result, Results
from monitor.commands.reproduce.wan2016.printed import DELAYS_S, ERRORS, Errors
from sim_feeds.faults import KNOT_M_S, FaultKind
from sim_feeds.papers.wan2016 import Group, Scenario, table1

__all__ = ["delay_of", "median", "why_delay", "why_faulty", "why_healthy"]

ALIKE: Final = 1.5
"""Two errors within this factor are called alike."""
STEP_S: Final = AirDataTuning().t_s
LOGIC: Final = TriplexTuning()
THRESHOLD_KT: Final = LOGIC.cas_threshold_m_s / KNOT_M_S
THRESHOLD_DEG: Final = math.degrees(LOGIC.alpha_threshold_rad)
_STEPS: Final = (FaultKind.BIAS, FaultKind.JAMMING, FaultKind.NRZ)
_CHANNELS: Final = (slice(0, 3), slice(3, 6))


def median(runs: Result) -> Errors:
    """Median errors of the runs of one form."""
    return Errors(*(float(v) for v in np.median(runs["errors"], axis=0)))


def delay_of(runs: Result, channel: int) -> Any:
    """Delay of the slowest broken sensor of a channel in each run [s], NaN where one is missed."""
    part = _CHANNELS[channel]
    broken = runs["broken"][0, part]
    return runs["delay_s"][:, part][:, broken].max(axis=1)


def why_healthy(name: str, channel: int, result: Result) -> str:
    """One sentence for the errors of a channel (0 AOA, 1 VCAS) without faults."""
    mean, unit = (("aoa_mean_deg", "deg"), ("cas_mean_kt", "kt"))[channel]
    runs = result["H"]["ours"], result["quiet"], result["smooth"]
    ours, quiet, smooth = (float(getattr(median(r), mean)) for r in runs)
    printed = float(getattr(ERRORS[f"{name}-H"], mean))
    if printed > ALIKE * ours:
        return (
            "Better than printed on average: our sensors have noise and the wind turbulence, but "
            "no calibration error and no lateral motion."
        )
    parts = {
        "the sensors' noise": ours - quiet,
        "turbulence": quiet - smooth,
        "the lag behind the wind's ramps": smooth,
    }
    main = max(parts, key=lambda word: parts[word])
    return (
        f"The largest part is {main}: with a tenth of the noise the mean is {quiet:.2g} {unit}, "
        f"without turbulence too {smooth:.2g} {unit}."
    )


def why_faulty(name: str, channel: int, result: Result) -> str:
    """One sentence for a row with faults: what the faults added to the healthy run."""
    runs = result["F"]["ours"]
    part = _CHANNELS[channel]
    broken = runs["broken"][0, part]
    missed = bool((np.isnan(runs["delay_s"]) & runs["broken"])[:, part].any())
    n, blamed = len(runs["broken"]), int(runs["blamed"][:, part].any(axis=1).sum())
    if missed and channel == 0:
        return "The vanes' fault stays below the threshold and in the fused value."
    if missed:
        return (
            "The airspeeds that fail together outweigh the healthy one in (19), the wind follows "
            f"them within its bounds, and they are missed (the healthy one is blamed in {blamed} "
            f"of {n} runs)."
        )
    if broken.all():
        return (
            "All three are removed: the wind is held at its value before the onset, and what it "
            "changes afterwards is the error; the paper's wind is free."
        )
    healthy, ours = median(result["H"]["ours"]), median(runs)
    grown = ours[2 * channel] > ALIKE * healthy[2 * channel]
    if grown and broken.any():
        slow = float(np.median(delay_of(runs, channel)))
        return f"In the {slow:.2g} s until the decision the fault moves the estimate."
    if grown:
        return "The other channel's fault moves this one through the common wind."
    if broken.any():
        return "As without faults: the sensors are removed before they move the estimate."
    return "As without faults: none of these sensors fails."


def why_delay(row: Scenario, channel: int, results: Results) -> str:
    """One sentence for a delay."""
    group = row.pitots if channel else row.vanes
    if group is None:
        raise ValueError(f"scenario {row.name}: channel {channel} has no fault")
    runs = results[f"scenario/{row.name}"]["F"]["ours"]
    delays = delay_of(runs, channel)
    printed = DELAYS_S.get(row.name, (None, None))[channel]
    if np.isnan(delays).any():
        return _why_missed(row, group, channel, runs)
    ours = float(np.median(delays))
    if group.kind is FaultKind.RUNAWAY:
        return _why_runaway(group, printed, results)
    if group.kind is FaultKind.OSCILLATION:
        return (
            f"Our sine of {1 / group.period_s:g} Hz begins at zero and takes part of its first "
            "quarter to cross the threshold; a shape that begins with a step would not."
        )
    if group.kind in _STEPS:
        return _why_step(float(np.median(runs["size"][:, 3 * channel])), channel, ours)
    if printed is not None and ours < 0.5 * printed:
        return (
            "A reading that repeats itself to the bit is a sign of its own in ours; as printed the "
            "sensors pass until the aircraft has left the value they keep, and two of them outvote "
            "the third."
        )
    return "The sensors kept their value: the delay is the time in which the aircraft leaves it."


def _why_step(size: float, channel: int, ours: float) -> str:
    """A step is decided when its rms has crossed the threshold and enough samples followed."""
    limit, unit = (THRESHOLD_KT, "kt") if channel else (THRESHOLD_DEG, "deg")
    crossing = math.ceil(LOGIC.N_eval * min(limit / size, 1.0) ** 2)
    least = (crossing + LOGIC.n_D - 1) * STEP_S
    samples = "sample" if crossing == 1 else "samples"
    step = f"{size:.{0 if size > 10 else 1}f} {unit}"
    text = f"A step of {step} has crossed {limit:g} {unit} rms after {crossing} {samples}"
    text += f" and is decided {LOGIC.n_D - 1} later, {least:.2f} s after the onset"
    if ours > least + 4 * STEP_S:
        return f"{text}; the rest is the wind estimate, which follows two sensors that agree."
    return f"{text}; the paper's step is not printed."


def _why_missed(row: Scenario, group: Group, channel: int, runs: Result) -> str:
    blamed = int(runs["blamed"].any(axis=1).sum())
    if group.kind is FaultKind.NRZ and not channel:
        return (
            f"Table II's {group.fraction:.0%} of a few degrees is far below {THRESHOLD_DEG:g} deg: "
            "no threshold of the papers sees it, so the simulator's must have been larger "
            "(compare 1v)."
        )
    apart = table1().duration_s - table1().onset_s
    return (
        f"The two that keep their value agree with each other and leave the healthy one by about "
        f"1 kt/s over {apart:.0f} s, which the wind is free to explain: the healthy one is blamed "
        f"in {blamed} of {len(runs['blamed'])} runs."
    )


def _why_runaway(group: Group, printed: float | None, results: Results) -> str:
    sweep = results["rate/6"]
    rates = np.asarray(sweep["values"]) * abs(group.rate_kt_s or 0.0)
    delays = np.nanmedian(sweep["ours"]["delay_s"][:, :, 3:5].max(axis=2), axis=1)
    text = f"The rate is not printed; at {group.rate_kt_s:g} kt/s {THRESHOLD_KT:g} kt take long"
    if printed is None or not np.isfinite(delays).all() or not delays.min() <= printed:
        return f"{text}, and no rate tried is as quick as the printed delay."
    matching = float(np.exp(np.interp(-printed, -delays, np.log(rates))))
    return f"{text}, and about {matching:.0f} kt/s give the printed delay."
