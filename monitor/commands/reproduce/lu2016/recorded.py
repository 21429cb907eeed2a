"""lu2016 section 5: the faults of Table 2 written into recorded flights and reconstructed.

The recordings are three ALFA flights of a 2 kg aircraft, healthy where they are used. Each of many
onsets is tried in every form (:mod:`monitor.commands.reproduce.lu2016.recorded_forms`); estimates
are also compared with what the same form says of the healthy recording, because a small IMU has
turn-on biases which no one injected.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from links.samples import Batch
from links.vocabulary import GYRO_ACC_AXES, State
from monitor.commands.bench_detect.flights import Flight
from monitor.commands.bench_detect.flights import recorded as read
from monitor.commands.inject import inject_log
from monitor.commands.reproduce.lu2016.methods import PRINTED
from monitor.commands.reproduce.lu2016.recorded_forms import (
    Estimates,
    Inputs,
    faults_at,
    filtered,
    inputs,
    piped,
)
from monitor.commands.reproduce.lu2016.recorded_names import (
    FOLLOWED,
    MENDED,
    OWN_TIMES,
    OWN_TIMES_SLOW,
    PAPER,
    PAPER_FAST,
    PIPELINE,
    PIPELINE_FOLLOWED,
)
from monitor.commands.reproduce.lu2016.recorded_shown import blocks, claims
from monitor.commands.reproduce.study import Job, Result, Scope
from monitor.settings import Settings, load
from monitor.verdict import Verdict
from sim_feeds.attitude_follow import AttitudeFollows
from sim_feeds.faults import Fault, lu2016_table2
from sim_feeds.injection import Injection, RowInjector
from sim_feeds.papers.lu2016_validation import RecordedFlight, RecordedSection, validation

__all__ = ["blocks", "claims", "jobs", "work"]

Floats = NDArray[np.float64]

FOLDER: Final = "alfa"
BEFORE_S: Final = 10.0
AFTER_S: Final = 10.0
"""Scored around the faults, as in the paper: 10 s, 20 s of faults, 10 s."""
SWING_S: Final = 4.0
"""Period of f_Az in Table 2."""
SETTLED_S: Final = 5.0
"""After which a reconstruction has settled."""


def jobs(scope: Scope) -> list[Job]:
    """One for each recording that is there."""
    if scope.flights is None:
        return []
    found = []
    for flight in validation().recorded.flight:
        path = scope.flights / FOLDER / flight.file
        if path.is_file():
            what = {"flight": flight.name, "log": str(path), "quick": scope.quick}
            found.append(Job("lu2016", f"recorded/{flight.name}", what, scope.seed))
    return found


def work(job: Job) -> Result:
    """All onsets of one recording, in all forms."""
    section = validation().recorded
    which = next(f for f in section.flight if f.name == job.what["flight"])
    settings = load(None, None)
    flight = read(Path(job.what["log"]), settings)
    healthy = _estimates(flight, flight.batch, settings, section)
    out: Result = {
        "flight": _described(flight, which, settings),
        "healthy": _healthy(healthy, which),
        "onsets": [],
    }
    duration_s = flight.duration_s
    for onset_s in section.onsets_s(which, duration_s, quick=job.what["quick"]):
        faults = lu2016_table2("imu0", onset_s, onset_s + section.fault_s)
        broken = _broken(flight, faults, None)
        followed = _broken(flight, faults, AttitudeFollows())
        found = _estimates(flight, broken, settings, section)
        found |= _followed(flight, followed, settings, section)
        out["onsets"].append(
            {
                "onset_s": onset_s,
                "forms": {
                    name: _scored(e, healthy[_BASE.get(name, name)], faults, onset_s, section)
                    for name, e in found.items()
                },
                "named": named_after(found[PIPELINE].verdicts, flight.first_us, onset_s, section),
                "named_followed": named_after(
                    found[PIPELINE_FOLLOWED].verdicts, flight.first_us, onset_s, section
                ),
            }
        )
        if onset_s == which.shown_s:
            out["lines"] = _lines(found, healthy, faults, onset_s, section)
            out["file"] = _by_file(Path(job.what["log"]), flight, faults, settings, found, section)
    return out


_MENDED: Final[dict[str, Any]] = {**PRINTED, "divide_by_dt": False, "detuning": 1.0}
"""Neither the division by dt of (53), which contradicts (46), nor the dt^2 of (57)."""

_BASE: Final = {FOLLOWED: PAPER, PIPELINE_FOLLOWED: PIPELINE}
"""Forms whose healthy recording is another form's."""


def _broken(flight: Flight, faults: list[Fault], follows: AttitudeFollows | None) -> Batch:
    return RowInjector(Injection(faults, follows), 0, flight.first_us).apply(flight.batch)


def _given(flight: Flight, batch: Batch, settings: Settings) -> Inputs:
    return inputs(batch, flight.first_us, settings.streams.gps_latency_s)


def _estimates(
    flight: Flight, batch: Batch, settings: Settings, section: RecordedSection
) -> dict[str, Estimates]:
    """By all forms, with the attitude as it was recorded."""
    given = _given(flight, batch, settings)
    slow = given.thinned(section.gps_hz)
    std = given.input_std(settings.imu, section.before_s)
    return {
        PAPER: filtered(slow, settings, std, interpolate=True, **PRINTED),
        MENDED: filtered(slow, settings, std, interpolate=True, **_MENDED),
        PAPER_FAST: filtered(given, settings, std, interpolate=True, **PRINTED),
        OWN_TIMES_SLOW: filtered(slow, settings, std, interpolate=False),
        OWN_TIMES: filtered(given, settings, std, interpolate=False),
        PIPELINE: piped(batch, flight.first_us, settings, own_attitude=True),
    }


def _followed(
    flight: Flight, batch: Batch, settings: Settings, section: RecordedSection
) -> dict[str, Estimates]:
    """Where the autopilot computes its attitude from the broken IMU."""
    given = _given(flight, batch, settings)
    std = given.input_std(settings.imu, section.before_s)
    return {
        FOLLOWED: filtered(
            given.thinned(section.gps_hz), settings, std, interpolate=True, **PRINTED
        ),
        PIPELINE_FOLLOWED: piped(batch, flight.first_us, settings, own_attitude=False),
    }


def _described(flight: Flight, which: RecordedFlight, settings: Settings) -> dict[str, Any]:
    """The healthy part in numbers."""
    given = _given(flight, flight.batch, settings)
    until = which.healthy_until_s or flight.duration_s
    imu, angles = given.um[given.imu_s < until], given.angles[given.angles_s < until]
    speed = np.hypot(*given.velocity[given.velocity_s < until, :2].T)
    return {
        "name": which.name,
        "file": which.file,
        "used_s": until,
        "az_m_s2": [float(imu[:, 2].min()), float(imu[:, 2].max())],
        "roll_deg": float(np.degrees(np.abs(angles[:, 0]).max())),
        "roll_rate_deg_s": float(np.degrees(np.abs(imu[:, 3]).max())),
        "speed_m_s": [float(speed.min()), float(speed.max())],
        "imu_hz": 1.0 / given.interval_s,
        "attitude_hz": 1.0 / float(np.median(np.diff(given.angles_s))),
        "gps_hz": 1.0 / float(np.median(np.diff(given.velocity_s))),
        "noise": given.input_std(settings.imu, until),
    }


def _healthy(found: dict[str, Estimates], which: RecordedFlight) -> dict[str, Any]:
    """Mean and deviation of what is said of the recording as it is."""
    out = {}
    for name, e in found.items():
        on = (e.t_s > BEFORE_S) & (e.t_s < (which.healthy_until_s or np.inf))
        out[name] = {
            "mean": np.nanmean(e.f[on], axis=0).tolist(),
            "std": np.nanstd(e.f[on], axis=0).tolist(),
        }
    return out


def _scored(
    e: Estimates, base: Estimates, faults: list[Fault], onset_s: float, section: RecordedSection
) -> dict[str, Any]:
    """Errors of one form for one onset."""
    end_s = onset_s + section.fault_s
    f = faults_at(faults, e.t_s)
    own = e.f - _at(base, e.t_s)
    scored = (e.t_s > onset_s - BEFORE_S) & (e.t_s < end_s + AFTER_S)
    late = (e.t_s > onset_s + SETTLED_S) & (e.t_s < end_s)
    error = own - f
    out: dict[str, Any] = {
        "rmse": _rms(error[scored]),
        "rmse_raw": _rms((e.f - f)[scored]),
        "rmse_late": _rms(error[late]),
        "bias_late": np.nanmean(error[late], axis=0).tolist(),
        "share_late": [a / b for a, b in zip(_rms(error[late]), _rms(f[late]), strict=True)],
        "largest": np.nanmax(np.abs(error[scored]), axis=0).tolist(),
        **swing_response(e.t_s[late], own[late, 2], f[late, 2]),
    }
    if e.residual is not None:
        before = (e.t_s > onset_s - BEFORE_S) & (e.t_s < onset_s)
        during = (e.t_s >= onset_s) & (e.t_s < end_s)
        out["residual_before"] = _rms(e.residual[before])
        out["residual_during"] = _rms(e.residual[during])
    return out


def swing_response(t_s: Floats, estimate: Floats, f: Floats) -> dict[str, float]:
    """How much of the oscillating f_Az comes out, and how late: the response at its frequency."""
    turning = np.exp(-2j * np.pi * t_s / SWING_S)
    response = np.sum((estimate - estimate.mean()) * turning) / np.sum((f - f.mean()) * turning)
    delay = -np.angle(response) / (2.0 * np.pi) * SWING_S
    return {"swing_share": float(abs(response)), "swing_delay_s": float(delay % SWING_S)}


def _rms(values: Floats) -> list[float]:
    return [float(v) for v in np.sqrt(np.nanmean(values**2, axis=0))]


def _at(e: Estimates, t_s: Floats) -> Floats:
    """Estimates at other times, linear."""
    return np.column_stack([np.interp(t_s, e.t_s, column) for column in e.f.T])


def named_after(
    verdicts: Any, first_us: int, onset_s: float, section: RecordedSection
) -> dict[str, float | None]:
    """Axis of imu0 -> seconds from the onset to the verdict that names it, while it lasts.

    Under "imu1" the first healthy axis of the other IMU that is called faulty.
    """
    out: dict[str, float | None] = {f"imu0.{axis}": None for axis in GYRO_ACC_AXES}
    out["imu1"] = None
    v: Verdict
    for v in verdicts:
        delay = (v.t_us - first_us) * 1e-6 - onset_s
        if v.state is not State.FAULTY or not 0.0 <= delay < section.fault_s:
            continue
        key = v.sensor if v.sensor in out else "imu1"
        if out[key] is None:
            out[key] = delay
    return out


def _lines(
    found: dict[str, Estimates],
    healthy: dict[str, Estimates],
    faults: list[Fault],
    onset_s: float,
    section: RecordedSection,
) -> dict[str, Any]:
    """What the figures show, around the faults."""
    out: dict[str, Any] = {}
    for name in (PAPER, OWN_TIMES, PIPELINE, FOLLOWED):
        e = found[name]
        on = (e.t_s > onset_s - BEFORE_S) & (e.t_s < onset_s + section.fault_s + AFTER_S)
        base = _at(healthy[_BASE.get(name, name)], e.t_s[on])
        line: dict[str, Any] = {"t_s": e.t_s[on] - onset_s, "f": e.f[on], "healthy": base}
        line["true"] = faults_at(faults, e.t_s[on])
        if e.residual is not None:
            line["residual"] = e.residual[on]
        out[name] = line
    return out


def _by_file(
    log: Path,
    flight: Flight,
    faults: list[Fault],
    settings: Settings,
    found: dict[str, Estimates],
    section: RecordedSection,
) -> dict[str, Any]:
    """The same by way of a file, as ``mavsentry inject`` writes it: what its rounding costs."""
    with TemporaryDirectory() as folder:
        to = Path(folder) / "broken.tlog"
        done = inject_log(log, Injection(faults), to, 0, settings.links.decoder_options())
        again = read(to, settings)
    by_file = _estimates(again, again.batch, settings, section)
    tally = [t for (sensor, _), t in done.injector.tallies.items() if sensor == "imu0"]
    return {
        "changed": int(sum(t.changed for t in tally)),
        "apart": {
            name: np.nanmax(np.abs(by_file[name].f - found[name].f), axis=0).tolist()
            for name in (PAPER, OWN_TIMES)
        },
        "duration_s": flight.duration_s,
    }
