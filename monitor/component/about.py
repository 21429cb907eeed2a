"""What we say of ourselves when asked: AUTOPILOT_VERSION, which every component may send."""

from __future__ import annotations

import re
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version

from monitor.publish import Message

__all__ = ["CAPABILITY", "about"]

CAPABILITY = {
    "COMMAND_INT": 1 << 3,
    "PARAM_ENCODE_BYTEWISE": 1 << 4,
    "MAVLINK2": 1 << 13,
    "PARAM_ENCODE_C_CAST": 1 << 17,
}
"""MAV_PROTOCOL_CAPABILITY by name."""

_RELEASED, _DEV = 255, 0


def about(capabilities: Callable[[], int] = lambda: 0) -> dict[str, Callable[[], Message]]:
    """Message name -> how it is made, of what can be asked for.

    Parameters
    ----------
    capabilities
        What services add to MAVLink 2 and COMMAND_INT: how parameters are encoded.
    """

    def autopilot_version() -> Message:
        own = CAPABILITY["MAVLINK2"] | CAPABILITY["COMMAND_INT"]
        fields = {"capabilities": own | capabilities(), "flight_sw_version": _version_word()}
        return Message("AUTOPILOT_VERSION", fields)

    return {"AUTOPILOT_VERSION": autopilot_version}


def _version_word() -> int:
    """Our version as MAVLink packs one: major, minor, patch, and the kind of release."""
    try:
        text = version("mavsentry")
    except PackageNotFoundError:  # run from its sources, not installed
        return 0
    found = re.match(r"(\d+)\.(\d+)\.(\d+)(.*)", text)
    if found is None:
        return 0
    major, minor, patch = (min(int(part), 255) for part in found.groups()[:3])
    return major << 24 | minor << 16 | patch << 8 | (_DEV if found[4] else _RELEASED)
