"""Connection strings to open links: UDP, TCP, serial ports and telemetry logs.

=====================================  ==========================================================
``udpin:HOST:PORT``                    listen; answers go to who spoke last (``udp:`` is the same)
``udpout:HOST:PORT``                   speak to one peer and hear it
``tcp:HOST:PORT``                      connect, again and again while there is no connection
``tcpin:HOST:PORT``                    accept a client; a new one takes the place of the last
``/dev/ttyX[:BAUD]``, ``COM3[:BAUD]``  serial port, 115200 baud unless given (extra ``serial``)
``FILE.tlog``                          the frames of a log, or a new log with ``write=True``
=====================================  ==========================================================

Every endpoint has ``recv``, ``send``, ``close`` and ``counters``, and is a context manager. What
goes wrong on an open link (no peer yet, peer gone, cable pulled) is counted and mended, not raised;
only what cannot work from the start raises :class:`LinkError`, in one plain sentence.
"""

from __future__ import annotations

import re
from pathlib import Path

from links.endpoints.base import Endpoint, LinkCounters, LinkError
from links.endpoints.files import LogEndpoint, LogWriterEndpoint
from links.endpoints.serial_port import DEFAULT_BAUD, SerialEndpoint
from links.endpoints.tcp import TcpClient, TcpServer
from links.endpoints.udp import UdpEndpoint

__all__ = ["Endpoint", "LinkCounters", "LinkError", "open_endpoint"]

_SERIAL = re.compile(r"(/dev/[^:]+|COM\d+|\\\\\.\\COM\d+|(?:loop|socket|rfc2217)://.+?)(?::(\d+))?")
_NETWORK = re.compile(r"(udpin|udpout|udp|tcpin|tcp):(.*)")
_HOST_PORT = re.compile(r"(?:\[([0-9A-Fa-f:.%\w]+)\]|([^:\[\]]+)):(\d+)")

AnyEndpoint = UdpEndpoint | TcpClient | TcpServer | SerialEndpoint | LogEndpoint | LogWriterEndpoint
"""Every kind of endpoint; each is an :class:`Endpoint`."""


def open_endpoint(spec: str, *, write: bool = False, dialect: str = "ardupilotmega") -> AnyEndpoint:
    """Open what a connection string says; the module's docstring lists the forms.

    Parameters
    ----------
    spec
        The connection string.
    write
        For a file: make it anew, to send into.
    dialect
        For reading a file: whose frames are recognised.

    Raises
    ------
    LinkError
        When the string says no link, or that link cannot be opened.
    """
    if network := _NETWORK.fullmatch(spec):
        kind, rest = network.groups()
        address = _HOST_PORT.fullmatch(rest)
        if address is None or not 0 <= int(address[3]) <= 65535:
            raise LinkError(f"{spec} is not of the form {kind}:HOST:PORT")
        host, port = address[1] or address[2], int(address[3])
        if kind in ("udpin", "udp", "udpout"):
            return UdpEndpoint(spec, host, port, listen=kind != "udpout")
        return TcpServer(spec, host, port) if kind == "tcpin" else TcpClient(spec, host, port)
    if port_name := _SERIAL.fullmatch(spec.removeprefix("serial:")):
        return SerialEndpoint(spec, port_name[1], int(port_name[2] or DEFAULT_BAUD))
    if spec.lower().endswith(".tlog"):
        path = Path(spec.removeprefix("file:"))
        return LogWriterEndpoint(spec, path) if write else LogEndpoint(spec, path, dialect)
    raise LinkError(
        f"{spec!r} is not a link: give udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, "
        "tcpin:HOST:PORT, /dev/ttyX[:BAUD] or FILE.tlog"
    )
