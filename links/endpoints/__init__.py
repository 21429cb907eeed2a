"""Connection strings to open links: UDP, TCP, serial ports and telemetry logs.

=====================================  ==========================================================
``udpin:HOST:PORT``                    listen; every peer that was believed is answered (``udp:``)
``udpout:HOST:PORT``                   speak to one peer and hear it
``tcp:HOST:PORT``                      connect, again and again while there is no connection
``tcpin:HOST:PORT``                    accept clients, hear and answer all of them
``/dev/ttyX[:BAUD]``, ``COM3[:BAUD]``  serial port, 115200 baud unless given (extra ``serial``);
                                       also a pattern, as ``/dev/serial/by-id/*Cube*-if00:57600``,
                                       and pyserial's ``hwgrep://2DAE:1016``
``FILE.tlog``                          the frames of a log, or a new log with ``write=True``
=====================================  ==========================================================

An IPv6 address stands in brackets: ``udpin:[::]:14550``.

Every endpoint has ``recv``, ``send``, ``close`` and ``counters``, and is a context manager; many of
them together are a :class:`Hub`. What goes wrong on an open link (no peer yet, peer gone, cable
pulled) is counted and mended, not raised; only what cannot work from the start raises
:class:`LinkError`, in one plain sentence. No call waits for anything but what ``recv`` is asked to.
"""

from __future__ import annotations

import re
from pathlib import Path

from links.endpoints.base import Endpoint, LinkCounters, LinkError, LinkOptions
from links.endpoints.files import LogEndpoint, LogWriterEndpoint
from links.endpoints.hub import Arrival, Hub, LinkState
from links.endpoints.serial_port import DEFAULT_BAUD, SerialEndpoint
from links.endpoints.tcp import TcpClient, TcpServer
from links.endpoints.udp import UdpListener, UdpSpeaker

__all__ = [
    "Arrival",
    "Endpoint",
    "Hub",
    "LinkCounters",
    "LinkError",
    "LinkOptions",
    "LinkState",
    "check_spec",
    "open_endpoint",
]

_SERIAL = re.compile(
    r"(/dev/.+?|COM\d+|\\\\\.\\COM\d+|(?:loop|socket|rfc2217)://.+?|hwgrep://[^@]+)"
    r"(?:[:,@](\d+))?"
)
_NETWORK = re.compile(r"(udpin|udpout|udp|tcpin|tcp):(.*)")
_HOST_PORT = re.compile(r"(?:\[([0-9A-Fa-f:.%\w]+)\]|([^:\[\]]+)):(\d+)")

AnyEndpoint = (
    UdpListener
    | UdpSpeaker
    | TcpClient
    | TcpServer
    | SerialEndpoint
    | LogEndpoint
    | LogWriterEndpoint
)
"""Every kind of endpoint; each is an :class:`Endpoint`."""


def open_endpoint(
    spec: str,
    *,
    write: bool = False,
    dialect: str = "ardupilotmega",
    options: LinkOptions | None = None,
) -> AnyEndpoint:
    """Open what a connection string says; the module's docstring lists the forms.

    Parameters
    ----------
    spec
        The connection string.
    write
        For a file: make it anew, to send into.
    dialect
        For reading a file: whose frames are recognised.
    options
        How it is kept open.

    Raises
    ------
    LinkError
        When the string says no link, or that link cannot be opened.
    """
    how = options or LinkOptions()
    kind, place, number = _read(spec)
    match kind:
        case "udpin":
            return UdpListener(spec, place, number, how)
        case "udpout":
            return UdpSpeaker(spec, place, number, how)
        case "tcpin":
            return TcpServer(spec, place, number, how)
        case "tcp":
            return TcpClient(spec, place, number, how)
        case "serial":
            return SerialEndpoint(spec, place, number, how)
    path = Path(place)
    return LogWriterEndpoint(spec, path) if write else LogEndpoint(spec, path, dialect)


def check_spec(spec: str) -> str:
    """Kind of link that a connection string says, without opening it.

    Raises
    ------
    LinkError
        It says none.
    """
    return _read(spec)[0]


def _read(spec: str) -> tuple[str, str, int]:
    """Kind; host, device or file; port or baud rate."""
    if network := _NETWORK.fullmatch(spec):
        kind, rest = network.groups()
        address = _HOST_PORT.fullmatch(rest)
        if address is None or not 0 <= int(address[3]) <= 65535:
            raise LinkError(
                f"{spec} is not of the form {kind}:HOST:PORT, such as {kind}:{_example(kind)}"
            )
        kind = "udpin" if kind == "udp" else kind
        return kind, address[1] or address[2], int(address[3])
    if port := _SERIAL.fullmatch(spec.removeprefix("serial:")):
        return "serial", port[1], int(port[2] or DEFAULT_BAUD)
    if spec.lower().endswith(".tlog"):
        return "file", spec.removeprefix("file:"), 0
    raise LinkError(
        f"{spec!r} is not a link: give udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, "
        "tcpin:HOST:PORT, /dev/ttyX[:BAUD] or FILE.tlog"
    )


def _example(kind: str) -> str:
    """An address for a link of this kind: all of ours to listen, our own to speak to."""
    port = 5760 if kind.startswith("tcp") else 14550
    return f"0.0.0.0:{port}" if kind in ("udpin", "udp", "tcpin") else f"127.0.0.1:{port}"
