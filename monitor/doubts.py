"""What a newcomer should be told: nothing arrives, it is not MAVLink, it is no fixed-wing aircraft.

None of it is a fault of a sensor, and all of it leaves the monitor with nothing to say; so it says
this, with what to do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from links.endpoints import LinkState

__all__ = ["about_flight", "about_links", "about_vehicle"]

NOTHING_S: Final = 5.0
"""An autopilot sends a heartbeat each second; after so long without anything something is wrong."""

NOISE_BYTES: Final = 500
"""So many bytes without a MAVLink message among them are none."""

REFERENCES: Final = ("gps", "attitude")
"""Sensors that are watched in any case, flying or not."""

NOT_WINGED: Final = frozenset(
    {
        *("QUADROTOR", "COAXIAL", "HELICOPTER", "HEXAROTOR", "OCTOROTOR", "TRICOPTER"),
        *("DODECAROTOR", "DECAROTOR", "ANTENNA_TRACKER", "AIRSHIP", "FREE_BALLOON", "ROCKET"),
        *("GROUND_ROVER", "SURFACE_BOAT", "SUBMARINE", "PARAFOIL", "KITE", "GCS"),
    }
)
"""MAV_TYPE that fly without wings, or not at all; VTOL aircraft have them."""


def about_links(states: Sequence[LinkState], waited_s: float, messages: int) -> list[str]:
    """Why no vehicle is heard, of links that are open.

    Parameters
    ----------
    states
        The inputs.
    waited_s
        Time since they were opened.
    messages
        MAVLink messages that came, of whomever.
    """
    if waited_s < NOTHING_S:
        return []
    said = []
    for state in states:
        if not state.open or state.name.endswith(".tlog"):
            continue
        count = state.counters.received_bytes
        if count == 0:
            said.append(f"nothing arrives on {state.name}: {_silent(state)}")
        elif messages == 0 and count > NOISE_BYTES:
            said.append(f"what arrives on {state.name} is no MAVLink: {_noise(state)}")
    if messages and not said:
        said.append(
            "MAVLink arrives, but none of an autopilot's (component 1): is it the vehicle's link, "
            "and [links] system_id and autopilot_component_id its own?"
        )
    return said


def _silent(state: LinkState) -> str:
    if state.name.startswith(("udpin:", "tcpin:")):
        return (
            "the vehicle or its router must send to this port of this computer, and no firewall "
            "be between"
        )
    if state.name.startswith(("udpout:", "tcp:")):
        return "is it the address of the vehicle or its router, and does it send there?"
    return (
        "check that receive and transmit are crossed, that the autopilot's port speaks MAVLink "
        "(ArduPilot: SERIALn_PROTOCOL 2), and the baud rate"
    )


def _noise(state: LinkState) -> str:
    if state.name.startswith(("udp", "tcp")):
        return "another program sends to this port; choose the one that the vehicle sends to"
    return (
        "the baud rate behind the device's name must be the autopilot's (ArduPilot: SERIALn_BAUD), "
        "and its port must speak MAVLink"
    )


def about_vehicle(kind: str) -> str | None:
    """A sentence if a vehicle of this MAV_TYPE has no wings."""
    if kind not in NOT_WINGED:
        return None
    return (
        f"the vehicle says that it is a {kind.lower().replace('_', ' ')}: only fixed-wing aircraft "
        "are judged, so do not trust what is said of it"
    )


def about_flight(summary: Mapping[str, Any], profile: str, flying_speed_m_s: float) -> list[str]:
    """What keeps a log's verdicts from meaning what they seem to, a sentence each.

    Parameters
    ----------
    summary
        ``summary.json``.
    profile, flying_speed_m_s
        That it was judged by, and ground speed from which that takes an aircraft for flying.
    """
    said = []
    if (wingless := about_vehicle(summary["vehicle"]["type"])) is not None:
        said.append(wingless)
    judged = [m for m in summary["monitored"] if not m["sensor"].startswith(REFERENCES)]
    reasons = {span["reason"] for m in judged for span in m["unmonitored"]}
    if judged and not any(m["seconds"] for m in judged) and "on ground" in reasons:
        said.append(
            f"nothing was judged: by the profile {profile} it never flew (ground speed above "
            f"{flying_speed_m_s:g} m/s, and off the ground); is it the profile of this aircraft?"
        )
    return said
