"""A scenario as the MAVLink frames of an autopilot, in order of transmission, and its truth.

::

    scenario = load("demo")
    for t_us, frame in frames(scenario, seed=1): ...          # vehicle time, bytes
    play(frames(scenario), send=endpoint.send, speed=3.0)      # paced in real time
    flight = scenario.fly(seed=1)
    save_truth(flight, Path("out"))                           # out/truth.json, out/truth.npz
"""

from __future__ import annotations

import heapq
import json
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as dialect

from sim_feeds.faults import Fault, FaultKind
from sim_feeds.messages import UNIX_START_S, Sending, sendings
from sim_feeds.scenario import Flight, Scenario

__all__ = ["frames", "frames_of", "play", "save_truth", "truth", "truth_table", "unix_us"]

Frame = tuple[int, bytes]
TRUTH_HZ: Final = 50.0


def frames(scenario: Scenario, seed: int | None = None) -> Iterator[Frame]:
    """Fly the scenario and give its frames as (vehicle time of transmission [us], bytes)."""
    return frames_of(scenario.fly(seed))


def frames_of(flight: Flight) -> Iterator[Frame]:
    """Frames of a flown scenario, in order of transmission."""
    packer = dialect.MAVLink(None, flight.scenario.messages.system_id, 1)
    queues = [_tagged(rank, sending) for rank, sending in enumerate(sendings(flight))]
    for t_us, _, message, values in heapq.merge(*queues, key=lambda item: item[:2]):
        yield t_us, _pack(packer, message, values)


def _tagged(rank: int, sending: Sending) -> Iterator[tuple[int, int, Any, tuple[Any, ...]]]:
    for t_us, values in sending:
        yield t_us, rank, sending.message, values


def _pack(packer: dialect.MAVLink, message: type[Any], values: tuple[Any, ...]) -> bytes:
    """One MAVLink 2 frame; counts the sequence number up."""
    frame = message(*values).pack(packer)
    packer.seq = (packer.seq + 1) % 256
    return bytes(frame)


def play(
    source: Iterable[Frame],
    send: Callable[[bytes], Any],
    speed: float | None = 1.0,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> int:
    """Send frames at the pace of the flight; returns how many were sent.

    Parameters
    ----------
    source
        Frames in order of time.
    send
        Takes the bytes of one frame.
    speed
        Times real time; None sends without waiting.
    clock, sleep
        Seconds; a frame that is due within a millisecond goes out at once.
    """
    count = 0
    start = clock()
    first_us: int | None = None
    for t_us, frame in source:
        if speed is not None:
            first_us = t_us if first_us is None else first_us
            wait = start + (t_us - first_us) * 1e-6 / speed - clock()
            if wait > 1e-3:
                sleep(wait)
        send(frame)
        count += 1
    return count


def unix_us(flight: Flight, t_us: int) -> int:
    """Unix time of a vehicle time of this flight, as its SYSTEM_TIME says [us]."""
    return UNIX_START_S * 1_000_000 + t_us - round(flight.scenario.start.boot_s * 1e6)


def truth_table(flight: Flight) -> dict[str, Any]:
    """The flight and its fault schedule, ready for JSON.

    ``onset_s`` and ``end_s`` count from the first record (the first HEARTBEAT leaves at the first
    moment of the flight); ``onset_t_us`` and ``end_t_us`` are vehicle time. ``kind`` is the
    verdicts' word, ``model`` the fault model.
    """
    scenario = flight.scenario
    return {
        "schema": "mavsentry/truth/1",
        "title": scenario.title,
        "aircraft": scenario.aircraft,
        "seed": flight.seed,
        "duration_s": float(flight.truth.t_s[-1]),
        "first_t_us": round(scenario.start.boot_s * 1e6),
        "start_unix_us": UNIX_START_S * 1_000_000,
        "airborne": _airborne(flight),
        "faults": [_fault_entry(flight, fault) for fault in flight.faults],
    }


def _airborne(flight: Flight) -> dict[str, float | None]:
    """First and last moment on the wings, seconds from the first record."""
    aloft = np.flatnonzero(flight.truth.airborne > 0.5)
    if not len(aloft):
        return {"from_s": None, "to_s": None}
    return {
        "from_s": float(flight.truth.t_s[aloft[0]]),
        "to_s": float(flight.truth.t_s[aloft[-1]]),
    }


_UNITS: Final = {"imu.acc": "m/s^2", "imu.gyro": "rad/s", "airspeed": "m/s", "aoa": "rad"}
_UNITS_OF_AIRCRAFT: Final = {"spool": "rpm", "wing": "%", "engine": ""}


SHARES: Final = (FaultKind.SCALE, FaultKind.NRZ, FaultKind.ICING, FaultKind.INTERMITTENT)
"""Kinds whose size is a share of the reading, or of the readings."""


def _unit(fault: Fault) -> str:
    if fault.kind in SHARES:
        return ""
    base, _, axis = fault.sensor.partition(".")
    part = base.partition("_")[0].rstrip("0123456789")
    if part in _UNITS_OF_AIRCRAFT:
        return _UNITS_OF_AIRCRAFT[part]
    key = base.rstrip("0123456789") + (f".{axis.split('_')[0]}" if axis else "")
    return _UNITS.get(key, "Pa" if key == "baro" else "m/s")


def _fault_entry(flight: Flight, fault: Fault) -> dict[str, Any]:
    boot_us = round(flight.scenario.start.boot_s * 1e6)

    def vehicle_us(t_s: float | None) -> int | None:
        return None if t_s is None else boot_us + round(t_s * 1e6)

    return {
        "sensor": fault.sensor,
        "kind": fault.kind.seen_as.value,
        "model": fault.kind.value,
        "onset_s": fault.start_s,
        "end_s": fault.end_s,
        "onset_t_us": vehicle_us(fault.start_s),
        "end_t_us": vehicle_us(fault.end_s),
        "size": fault.size,
        "rate_per_s": fault.rate,
        "limit": fault.limit if np.isfinite(fault.limit) else None,
        "unit": _unit(fault),
    }


def truth(flight: Flight, rate_hz: float = TRUTH_HZ) -> dict[str, NDArray[Any]]:
    """Truth arrays by name and ``t_us``.

    They are the fields of :class:`~sim_feeds.trajectory.Truth`; of an aircraft with six degrees of
    freedom also its commands, shaft speeds and damage, see
    :class:`sim_feeds.sixdof.vehicle.VehicleFlight`.
    """
    step = max(1, round(1.0 / (rate_hz * flight.truth.dt_s)))
    thin = flight.truth.every(step)
    t_us = np.rint((thin.t_s + flight.scenario.start.boot_s) * 1e6).astype(np.int64)
    arrays = {"t_us": t_us, **{f.name: getattr(thin, f.name) for f in fields(thin)}}
    if flight.controls is not None:
        arrays |= {name: getattr(flight.controls, name)[::step] for name in DONE}
    return arrays


DONE: Final = ("elevator", "aileron", "rudder", "throttle", "shaft_rpm", "damage_percent")
"""What a kinematic aircraft does not have."""


def save_truth(flight: Flight, folder: Path, stem: str = "truth") -> tuple[Path, Path]:
    """Write ``<stem>.json`` (flight and faults) and ``<stem>.npz`` (truth arrays, 50 Hz)."""
    folder.mkdir(parents=True, exist_ok=True)
    table, arrays = folder / f"{stem}.json", folder / f"{stem}.npz"
    table.write_text(json.dumps(truth_table(flight), indent=1) + "\n", encoding="utf-8")
    columns: dict[str, Any] = truth(flight)
    np.savez_compressed(arrays, **columns)
    return table, arrays
