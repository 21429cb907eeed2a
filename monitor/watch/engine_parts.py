"""The parts of the engine watch as its kernels want them: events, groups of channels, models."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators import engine_state as es
from estimators import engine_ticks as et
from estimators.engine_model import (
    EngineModel,
    envelope,
    features,
    free_shaft,
    single_shaft,
    two_spool,
)
from estimators.engine_power import PowerRules
from estimators.imkf import IntermittentFilter, Settings
from links.samples import Rows
from monitor.settings.engine import ChannelSettings, EngineSettings

__all__ = ["Grid", "Unit", "events_of", "groups", "judge_rules", "tick_rules", "units"]

Array = NDArray[np.float64]

BARE_NOISE, BARE_RANGE_RPM = 0.01, 1e4
"""Of a channel that is not configured, for the odds that several fail together."""
BARE_FAULT = 0.01
NOZZLE = 1
"""Place of a two-spool engine's nozzle among the throttles."""

_PARAMS = {b"FUNCTION": et.PARAM_FUNCTION, b"MIN": et.PARAM_MIN, b"MAX": et.PARAM_MAX,
           b"REVERSED": et.PARAM_REVERSED}  # fmt: skip
_EVENT = np.dtype(
    [("t_us", "<i8"), ("seq", "<i8"), ("code", "<i8"), ("index", "<i8"), ("value", "<f8", 2)]
)


def tick_rules(s: EngineSettings) -> et.TickRules:
    """The grid, and which servo output drives each shaft."""
    given = s.throttle_channels or (0,)
    outputs = [(given[i] if i < len(given) else given[0]) - 1 for i in range(et.N_SHAFTS)]
    if s.model == "two-spool":  # one throttle drives both; the second input is the nozzle
        outputs[NOZZLE] = s.two_spool.nozzle_channel - 1
    return et.TickRules(s.tick_s, s.power_time_s, np.array(outputs, np.int64))


def judge_rules(s: EngineSettings) -> es.JudgeRules:
    """The limits."""
    return es.JudgeRules(
        tick_s=s.tick_s,
        wrong_share=s.wrong_share,
        wrong_s=s.wrong_s,
        least_wrong=float(s.least_wrong),
        readmit_s=s.readmit_s,
        stuck_s=s.stuck_s,
        moved_share=s.moved_share,
        tied_share=s.tied_share,
        dead_share=s.dead_share,
        low_share=s.low_share,
        decide_margin=s.decide_margin,
        decide_information=s.decide_information,
        stop_probability=s.stop_probability,
        no_power_s=s.no_power_s,
        no_power_throttle=s.no_power_throttle,
        cut_s=s.cut_s,
        power=PowerRules(s.glide_ratio, s.power_time_s, s.tick_s),
    )


def groups(s: EngineSettings) -> es.Groups:
    """Shafts of the configured channels; every other channel is a shaft of its own."""
    n = et.N_CHANNELS
    of = np.arange(n) + et.N_SHAFTS
    engine = np.concatenate([np.arange(et.N_SHAFTS), np.arange(n)])
    kind = np.full(es.N_GROUPS, es.BARE)
    throttle = np.zeros(es.N_GROUPS, np.int64)
    width, noise = np.full(n, BARE_RANGE_RPM), np.full(n, BARE_NOISE * BARE_RANGE_RPM)
    fault = np.full(n, BARE_FAULT)
    for sensor, channel in s.channels.items():
        i = int(sensor.removeprefix("spool"))
        of[i] = channel.shaft
        width[i], noise[i] = channel.range_rpm, channel.noise_rpm
        fault[i] = channel.fault_probability
    for shaft in range(et.N_SHAFTS):
        count = sum(c.shaft == shaft for c in s.channels.values())
        if s.model != "none":
            kind[shaft] = es.MODEL
        elif count > 1:
            kind[shaft] = es.PEERS
        throttle[shaft] = 0 if s.model == "two-spool" else shaft
    if s.model == "two-spool":
        engine[1] = 0
    return es.Groups(of, engine, kind, throttle, width, noise, fault)


@dataclass(frozen=True, slots=True)
class Unit:
    """One model with its filter.

    Attributes
    ----------
    channels : (m,) int64
        Which channels it hears.
    shafts : (S,) int64
        Which shafts' speeds it knows.
    throttle
        Which shaft's throttle is its input.
    kind
        The settings' word for the model.
    nozzle_area
        Of a two-spool engine without a servo for it; None with one.
    coefficients : (5,) float64
        Of the single-shaft curve.
    past : (h, m) float64 [rpm]
        What the channels should have read in the last moments, NaN before there were any.
    """

    model: EngineModel
    filter: IntermittentFilter
    channels: NDArray[np.int64]
    shafts: NDArray[np.int64]
    throttle: int
    kind: str
    nozzle_area: float | None
    coefficients: Array
    past: Array

    def inputs(self, table: Array) -> Array:
        """Inputs of the steps, (K, r) float64."""
        throttle = table[:, et.X_THROTTLE + self.throttle]
        if self.kind == "single-shaft":
            return features(throttle, table[:, et.X_AIRSPEED])
        if self.kind == "two-spool":
            nozzle = table[:, et.X_THROTTLE + NOZZLE]
            if self.nozzle_area is not None:
                nozzle = np.full_like(throttle, self.nozzle_area)
            return np.column_stack([throttle, nozzle])
        return np.zeros((len(table), 1))

    def limits(self, inputs: Array, x: Array, expected: Array) -> tuple[Array, Array]:
        """Least and most that each channel may read at the steps, each (K, m) float64 [rpm].

        A reading without a stamp of its own is older than it seems, and a throttle output that
        comes ten times a second may have moved since: what the model gave within the last moments,
        and where throttle and airspeed are driving it, are both no contradiction.
        """
        least, most = envelope(self.past, expected)
        if self.kind == "single-shaft":
            driven = inputs @ self.coefficients + x[:, 1]
            driven = np.where(np.isfinite(driven), np.maximum(driven, 0.0), expected[:, 0])[:, None]
            least, most = np.minimum(least, driven), np.maximum(most, driven)
        return least, most


def units(s: EngineSettings) -> list[Unit]:
    """The filters that the configured channels ask for."""
    by_shaft: dict[int, list[tuple[int, ChannelSettings]]] = {}
    for sensor, channel in s.channels.items():
        shaft = 0 if s.model == "two-spool" else channel.shaft
        by_shaft.setdefault(shaft, []).append((int(sensor.removeprefix("spool")), channel))
    out = []
    for shaft, mine in sorted(by_shaft.items()):
        if s.model == "none" and len(mine) == 1:
            continue
        mine.sort(key=lambda pair: pair[0])
        channels = [c for _, c in mine]
        model = _model(s, channels)
        known = np.array([0, 1] if s.model == "two-spool" else [shaft])
        settings = Settings(
            fault_free=tuple(1.0 - c.fault_probability for c in channels),
            ranges=tuple(c.range_rpm for c in channels),
            memory_s=s.memory_s,
        )
        out.append(
            Unit(
                model,
                IntermittentFilter(model.linear, settings, model.x, model.P),
                np.array([i for i, _ in mine]),
                known,
                shaft,
                s.model,
                None if s.two_spool.nozzle_channel else s.two_spool.nozzle_area,
                np.array(s.single_shaft.coefficients),
                np.full((max(round(s.timing_s / s.tick_s), 1), len(mine)), np.nan),
            )
        )
    return out


def _model(s: EngineSettings, channels: list[ChannelSettings]) -> EngineModel:
    noise = np.array([c.noise_rpm for c in channels])
    width = max(c.range_rpm for c in channels)
    if s.model == "none":
        return free_shaft(noise, width, s.tick_s)
    if s.model == "single-shaft":
        m = s.single_shaft
        return single_shaft(
            m.time_constant_s,
            m.coefficients,
            m.error_rpm,
            m.error_time_s,
            noise,
            width,
            s.tick_s,
        )
    t = s.two_spool
    return two_spool(
        np.array(t.a),
        np.array(t.b),
        t.sample_s,
        t.process_std,
        t.full_scale_rpm,
        np.array([c.shaft for c in channels]),
        noise,
        s.tick_s,
    )


def events_of(rows: Mapping[str, Rows]) -> tuple[Rows, Array]:
    """Events of all streams in order of time, and the servo pulses that they point at."""
    parts: list[Rows] = []
    pwm = np.zeros((0, 16))
    for sensor, r in rows.items():
        if not len(r):
            continue
        quantity = sensor.rstrip("0123456789")
        number = int(sensor[len(quantity) :] or 0)
        match quantity:
            case "servo":
                parts.append(_events(r, et.EV_SERVO, np.arange(len(r))))
                pwm = np.ascontiguousarray(r["pwm_us"], np.float64)
            case "spool" if number < et.N_CHANNELS:
                parts.append(_events(r, et.EV_SPOOL, number, r["speed_rpm"]))
            case "airspeed" if number < 3:
                parts.append(_events(r, et.EV_CAS, number, r["cas_m_s"]))
            case "gps" if number == 0:
                vel = r["vel_ned_m_s"]
                parts.append(_events(r, et.EV_GPS, 0, np.hypot(vel[:, 0], vel[:, 1])))
            case "baro" if number == 0:
                # 44330.8 m (1 - (p / p0)^0.190263): the standard atmosphere's height of a pressure
                height = 44330.8 * (1.0 - np.power(r["static_press_pa"] / 101325.0, 0.190263))
                parts.append(_events(r, et.EV_BARO, 0, height))
            case "nav":
                parts.append(_events(r, et.EV_NAV, 0, r["alt_m"]))
            case "demand":
                events = _events(r, et.EV_DEMAND, 0, r["height_error_m"])
                events["value"][:, 1] = r["airspeed_error_sign"]
                parts.append(events)
            case "heartbeat":
                parts.append(_events(r, et.EV_MODE, 0, r["autonomous"]))
            case "phase":
                parts.append(_events(r, et.EV_PHASE, 0, r["flying"]))
            case "param":
                parts += _params(r)
    if not parts:
        return np.zeros(0, _EVENT), pwm
    events = np.concatenate(parts)
    events = events[np.isfinite(events["value"][:, 0])]
    return events[np.lexsort((events["seq"], events["t_us"]))], pwm


def _events(r: Rows, code: int, index: int | NDArray[np.int64], value: Array | float = 0.0) -> Rows:
    events = np.zeros(len(r), _EVENT)
    events["t_us"], events["seq"], events["code"], events["index"] = (
        r["t_us"],
        r["seq"],
        code,
        index,
    )
    events["value"][:, 0] = value
    return events


def _params(r: Rows) -> list[Rows]:
    """SERVOn_FUNCTION, _MIN, _MAX and _REVERSED."""
    out = []
    for row in r[np.char.startswith(r["name"], b"SERVO")]:
        number, _, what = bytes(row["name"]).removeprefix(b"SERVO").partition(b"_")
        if what in _PARAMS and number.isdigit() and 1 <= int(number) <= 16:
            index = np.array([16 * _PARAMS[what] + int(number) - 1])
            out.append(_events(np.array([row]), et.EV_PARAM, index, float(row["value"])))
    return out


class Grid:
    """Rows to closed steps of the grid of :mod:`estimators.engine_ticks`.

    Attributes
    ----------
    epoch_us
        Time of the first row, which is 0 s of the grid [us]; 0 before it.
    """

    def __init__(self, s: EngineSettings) -> None:
        self.epoch_us = 0
        self._ticks = et.new_ticks(s.throttle_idle_us, s.throttle_full_us)
        self._rules = tick_rules(s)
        self._begun = False
        self._last_s = 0.0

    def retune(self, s: EngineSettings) -> None:
        """Take another averaging time; the grid itself stands."""
        self._rules = tick_rules(s)

    def steps(self, rows: Mapping[str, Rows]) -> tuple[Array, Array]:
        """Steps that these rows close: table and speeds of :func:`estimators.engine_ticks.gather`.

        Both are empty where no step is closed.
        """
        events, pwm = events_of(rows)
        if not len(events):
            return np.zeros((0, et.N_TABLE)), np.zeros((0, et.N_CHANNELS))
        if not self._begun:
            self.epoch_us, self._begun = int(events["t_us"][0]), True
        t = (events["t_us"] - self.epoch_us) * 1e-6
        most = et.ticks_bound(t, self._last_s, self._rules.tick_s)
        self._last_s = float(t[-1])
        table, y = np.empty((most, et.N_TABLE)), np.empty((most, et.N_CHANNELS))
        closed = et.gather(
            self._ticks,
            self._rules,
            t,
            np.ascontiguousarray(events["code"]),
            np.ascontiguousarray(events["index"]),
            np.ascontiguousarray(events["value"]),
            pwm,
            table,
            y,
        )
        return table[:closed], y[:closed]
