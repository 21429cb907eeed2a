"""Which bit of which mask is which sensor: what is published in flight and read back from logs.

A mask goes out as a NAMED_VALUE_FLOAT: ``FLT_<mask>`` has the bits of the faulty sensors,
``MON_<mask>`` those of the sensors that are being judged, ``EVT_ENG`` the engines that stopped.
Every mask fits in 24 bits and is exact in a float.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

from links.vocabulary import GYRO_ACC_AXES, State

__all__ = ["ENGINES", "FAULT", "MONITORED", "SENSORS", "mask_bit", "masks", "stopped_engines"]

FAULT, MONITORED = "FLT_", "MON_"
ENGINES = "EVT_ENG"

SENSORS: Final[Mapping[str, Mapping[int, str]]] = {
    **{
        f"IMU{i}": {bit: f"imu{i}.{axis}" for bit, axis in enumerate(GYRO_ACC_AXES)}
        for i in range(5)
    },
    "AIR": {i: f"airspeed{i}" for i in range(3)} | {8 + i: f"aoa{i}" for i in range(3)},
    "ENG": {i: f"spool{i}" for i in range(24)},
    "WNG": dict(
        enumerate(("wing_left.lift", "wing_left.drag", "wing_right.lift", "wing_right.drag"))
    ),
}
"""Mask -> bit -> sensor."""

_PLACES = {sensor: (mask, bit) for mask, bits in SENSORS.items() for bit, sensor in bits.items()}


def mask_bit(sensor: str) -> tuple[str, int] | None:
    """Mask and bit of a sensor: ``mask_bit("imu1.gyro_x") == ("IMU1", 3)``; None if it has none."""
    return _PLACES.get(sensor)


def masks(states: Mapping[str, State], which: Iterable[State]) -> dict[str, int]:
    """Mask name -> bits of the sensors that are in one of the states ``which``.

    A mask is there, with zero, for every group of which a sensor is known and not absent.
    """
    chosen = frozenset(which)
    out: dict[str, int] = {}
    for sensor, state in states.items():
        place = mask_bit(sensor)
        if place is None or state is State.ABSENT:
            continue
        name, bit = place
        out[name] = out.get(name, 0) | ((1 << bit) if state in chosen else 0)
    return dict(sorted(out.items()))


def stopped_engines(states: Mapping[str, State]) -> dict[str, int]:
    """``EVT_ENG``: bit i of ``engine<i>`` that has stopped; nothing while no engine is known."""
    engines = {s: state for s, state in states.items() if s.startswith("engine")}
    if not engines:
        return {}
    bits = (1 << int(s[6:]) for s, state in engines.items() if state is State.STOPPED)
    return {ENGINES: sum(bits)}
