"""Flights with one thing broken, as their report sees them, made of rows in memory."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from links.logs import LogInfo
from links.samples import Batch
from monitor import summary
from monitor.analyze import summarize
from monitor.pipeline import Pipeline
from monitor.recording import Estimates
from monitor.report.flight import Flight
from monitor.report.tables import MemoryTables
from monitor.settings import Settings
from monitor.settings.engine import ChannelSettings, EngineSettings, SingleShaftSettings
from monitor.settings.wing import WingSettings
from monitor.traces import Traces
from monitor.verdict import StepResult
from tests.monitor.engine_flights import BOOT_S, aerosonde, batch_of
from tests.monitor.wing_flights import rows_of

Floats = NDArray[np.float64]
Change = Callable[[Floats], Floats]

BROKEN_S = 80.0
"""Of an engine or one of its channels; the flights last 150 s."""
WING_S = 60.0


def dead(speeds: Floats) -> Floats:
    """No pulses."""
    return 0.0 * speeds


def high(speeds: Floats) -> Floats:
    """600 rpm too many."""
    return speeds + 600.0


def flown(batch: Batch, settings: Settings) -> Flight:
    """What the pipeline says of rows, and what there is to draw."""
    traces = Traces(settings.engine)
    pipeline, ledger = Pipeline(settings, taps=[traces]), summary.Ledger()
    estimates = Estimates()

    def use(result: StepResult) -> None:
        ledger.add(result.verdicts)
        estimates.add(result.estimates | traces.take())

    use(pipeline.feed(batch))
    use(pipeline.finish())
    estimates.add(traces.finish())
    times = np.concatenate([rows["t_us"] for rows in batch.rows.values()])
    first_us, last_us = int(times.min()), int(times.max())
    info = LogInfo(Path("flight.tlog"), "tlog", first_t_us=first_us, last_t_us=last_us)
    made_by = {"version": "0.0.0", "profile": settings.profile, "changed": {}}
    found = summarize(info, pipeline, ledger) | {
        "learnt": None,
        "baselines": {},
        "made_by": made_by,
    }
    return Flight(found, settings, ledger.verdicts, MemoryTables(estimates.joined()))


def modelled(channels: int) -> EngineSettings:
    """An electric motor's speed as a curve of throttle and airspeed, fitted on the whole flight."""
    t, y = aerosonde(4)["throttle"], aerosonde(4)["rpm"]
    v = aerosonde(4)["tas"]
    columns = np.column_stack([np.ones_like(t), t, t * t, v, t * v])
    c = np.linalg.lstsq(columns, y, rcond=None)[0]
    names = [f"spool{i}" for i in range(channels)]
    channel = ChannelSettings(range_rpm=8000.0, noise_rpm=25.0)
    return EngineSettings(
        model="single-shaft",
        channels=dict.fromkeys(names, channel),
        single_shaft=SingleShaftSettings(coefficients=tuple(map(float, c)), error_rpm=100.0),
    )


@cache
def with_channel(change: Change, channels: int = 2) -> Flight:
    """An engine whose first channel is changed from :data:`BROKEN_S` on."""
    rows = dict(batch_of(aerosonde(4), channels).rows)
    r = rows["spool0"] = rows["spool0"].copy()
    on = r["t_us"] * 1e-6 - BOOT_S >= BROKEN_S
    r["speed_rpm"][on] = change(r["speed_rpm"][on])
    return flown(Batch(rows), Settings(engine=modelled(channels)))


@cache
def engine_cut(channels: int) -> Flight:
    """An engine that stops at :data:`BROKEN_S`."""
    batch = batch_of(aerosonde(4, cut_s=BROKEN_S), max(channels, 1))
    rows = {s: r for s, r in batch.rows.items() if channels or not s.startswith("spool")}
    return flown(Batch(rows), Settings(engine=modelled(channels) if channels else EngineSettings()))


@cache
def wing_damaged() -> Flight:
    """An aircraft whose right wing loses 10 % of its lift at :data:`WING_S`."""
    from sim_feeds.sixdof import WingFault, fly_aerosonde

    fault = WingFault("right.lift", WING_S, 10.0)
    flight = fly_aerosonde((fault,), seed=71, wind_share=0.22, duration_s=110.0)
    wing = WingSettings.model_validate({"airframe": "aerosonde", "coefficient_share": 0.05})
    batch = rows_of(flight, seed=71)
    imu = batch.rows["imu0"]
    for axis in range(3):
        rate = np.interp(imu["t_us"] * 1e-6, flight.t_s, flight.rate_rad_s[:, axis])
        imu["gyro_rad_s"][:, axis] = rate + 1e-3 * np.random.default_rng(axis).standard_normal(
            len(imu)
        )
    return flown(batch, Settings(wing=wing))
