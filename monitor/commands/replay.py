"""``mavsentry replay``: send a recorded flight over a link, as it was received."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from monitor.commands import completing
from monitor.commands.common import Refused, note, open_link, progress

__all__ = ["replay", "speed_of"]

CHUNK_BYTES = 1 << 16
MAX_FRAMES_PER_S = 5000.0
"""Pace of ``--speed max``: a receiver's buffer must hold what comes between two of its turns."""

GAP_MAX_S = 10.0
"""A longer pause of the recording is cut to this."""


def speed_of(text: str) -> float | None:
    """Factor of real time; None for ``max``.

    Raises
    ------
    Refused
        Neither ``max`` nor a positive number.
    """
    if text == "max":
        return None
    try:
        speed = float(text)
    except ValueError:
        speed = 0.0
    if not 0 < speed <= 1000:
        raise Refused(f"--speed takes max or a factor of real time up to 1000, not {text!r}")
    return speed


def replay(
    log: Annotated[
        Path,
        typer.Argument(
            metavar="LOG", help="Telemetry log (.tlog).", autocompletion=completing.logs
        ),
    ],
    to: Annotated[
        str,
        typer.Option(
            "--to", metavar="LINK", help="Where to send it.", autocompletion=completing.links
        ),
    ] = ("udpout:127.0.0.1:14550"),
    speed: Annotated[
        str, typer.Option(metavar="FACTOR|max", help="1 is as it was received.")
    ] = "1",
) -> None:
    """Send a recorded flight over a link, frame by frame at the pace of its stamps."""
    factor = speed_of(speed)
    frames = _frames(log)
    sent = 0
    with open_link(to) as link, progress(f"replaying {log.name}") as tell:
        began_s = time.monotonic()
        due_s, last_us = 0.0, None
        for stamp_us, frame, fraction in frames:
            gap_s = 0.0 if last_us is None else min((stamp_us - last_us) / 1e6, GAP_MAX_S)
            due_s += 1.0 / MAX_FRAMES_PER_S if factor is None else gap_s / factor
            last_us = stamp_us
            ahead_s = began_s + due_s - time.monotonic()
            if ahead_s > 0.001:
                tell(fraction)
                time.sleep(ahead_s)
            link.send(frame)
            sent += 1
    note(f"mavsentry: sent {sent} frames in {time.monotonic() - began_s:.1f} s")


def _frames(log: Path) -> Iterator[tuple[int, bytes, float]]:
    """Stamp [us], frame, and how far in the file; refuses what is no telemetry log.

    A frame without a stamp has the last one's. Signing keys that somebody sent then are left out.
    """
    from links.mavlink.dialect import load_dialect
    from links.mavlink.framing import NO_STAMP, Framer
    from links.mavlink.signing import carries_key
    from monitor.recorder import whole_frames

    framer = Framer(load_dialect(), stamped=True)
    try:
        size = log.stat().st_size
        with log.open("rb") as file:
            stamp_us, found = 0, False
            while True:
                data = file.read(CHUNK_BYTES)
                frames = framer.feed(data) if data else framer.finish()
                for frame, stamp in whole_frames(frames):
                    found = True
                    stamp_us = stamp_us if stamp == NO_STAMP else max(stamp, stamp_us)
                    if not carries_key(frame):
                        yield stamp_us, frame, file.tell() / max(size, 1)
                if not data:
                    break
    except OSError as error:
        raise Refused(f"cannot read {log}: {error.strerror}") from None
    if not found:
        raise Refused(f"{log} has no MAVLink frame in it: only telemetry logs (.tlog) are replayed")
