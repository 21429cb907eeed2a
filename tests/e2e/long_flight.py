"""A flight as long as one likes, sent over UDP at any speed by a process of little cost.

    python -m tests.e2e.long_flight --to PORT [--imus 4] [--laps 3] [--straight-s 20]

A few laps of a circuit in turbulence are flown and encoded once. Each of them begins and ends with
the same heading, height and speed, and lasts whole seconds; so the laps after the first can follow
each other for ever, with their stamps moved on, new sequence numbers and checksums. At a seam only
the turbulence and the autopilot's errors of attitude jump, by less than their standard deviation.

Commands come as lines of JSON: ``{"speed": 4.0}`` (times real time; 0 pauses), ``{"end": true}``.
Twice a second it tells ``{"t_us", "sent", "late_s"}``: newest stamp, frames, how far it is behind.
"""

from __future__ import annotations

import argparse
import json
import socket
import sys
import threading
import time
from collections.abc import Iterator
from math import ceil

import numpy as np
from fastcrc.crc16 import mcrf4xx

from links.mavlink.dialect import load_dialect
from sim_feeds.player import frames_of
from sim_feeds.scenario import Flight, parse

HEAD, SEQUENCE, CHECKSUM = 10, 4, 2
STAMPS = (("time_boot_ms", 4, 1000), ("time_usec", 8, 1), ("time_unix_usec", 8, 1))
SLICE_S = 0.002
TELL_S = 0.5

LAP = """
[[leg]]
do = "level"
duration_s = {straight_s}
[[leg]]
do = "turn"
angle_deg = 180.0
[[leg]]
do = "climb"
rate_m_s = 1.5
duration_s = 8.0
[[leg]]
do = "climb"
rate_m_s = -1.5
duration_s = 8.0
[[leg]]
do = "turn"
angle_deg = 180.0
[[leg]]
do = "level"
duration_s = {last_s}
"""

FLIGHT = """
title = "Laps without end: {imus} IMUs at 200 Hz, two pitots"
aircraft = "small-uav"
seed = 11
[start]
speed_m_s = 20.0
agl_m = 150.0
{laps}
[[wind]]
kind = "constant"
speed_m_s = 4.0
toward_deg = 60.0
[[wind]]
kind = "dryden"
wind_6m_m_s = 3.0
[imu]
count = {imus}
rate_hz = 200.0
acc_noise_m_s2 = 0.2
[airspeed]
count = 2
[baro]
count = 2
[messages]
imu = "highres"
"""


def fly(laps: int, imus: int = 4, straight_s: float = 20.0) -> tuple[Flight, float]:
    """The first lap and ``laps`` more, and how long each lasts [s]."""
    lap = LAP.format(straight_s=straight_s, last_s=straight_s)
    one_s = parse(FLIGHT.format(imus=imus, laps=lap)).duration_s
    lap = LAP.format(straight_s=straight_s, last_s=straight_s + ceil(one_s) - one_s)
    text = FLIGHT.format(imus=imus, laps=lap * (laps + 1))
    return parse(text).fly(), float(ceil(one_s))


class Laps:
    """Encoded laps, repeated without end.

    Parameters
    ----------
    flight, lap_s
        As :func:`fly` gives them.
    """

    def __init__(self, flight: Flight, lap_s: float) -> None:
        messages = load_dialect().by_id
        first_us = None
        self._frames: list[tuple[int, bytearray, tuple[tuple[int, int, int], ...], bytes]] = []
        for t_us, frame in frames_of(flight):
            first_us = t_us if first_us is None else first_us
            message = messages[int.from_bytes(frame[7:10], "little")]
            fields = message.dtype.fields or {}
            stamps = tuple((HEAD + fields[n][1], w, p) for n, w, p in STAMPS if n in fields)
            body = bytearray(frame[:-CHECKSUM])
            need = max((at + width for at, width, _ in stamps), default=0)
            body += bytes(max(need - len(body), 0))  # a stamp whose upper zeros were cut off
            body[1] = len(body) - HEAD
            self._frames.append((t_us - first_us, body, stamps, bytes([message.crc_extra])))
        self._lap_us = round(lap_s * 1e6)
        moments = np.array([t_us for t_us, *_ in self._frames])
        self._again = int(np.searchsorted(moments, self._lap_us))
        flown = round(int(moments[-1]) / self._lap_us)
        self._length_us = (flown - 1) * self._lap_us
        self._stop = int(np.searchsorted(moments, self._lap_us + self._length_us))
        self.first_us = int(first_us or 0)
        self.frames_per_s = (self._stop - self._again) / (self._length_us * 1e-6)

    def __iter__(self) -> Iterator[tuple[int, bytes]]:
        """Time since the start [us] and frame, without end."""
        sequence, shift_us, first = 0, 0, 0
        while True:
            for k in range(first, self._stop):
                t_us, body, stamps, extra = self._frames[k]
                frame = bytearray(body)
                frame[SEQUENCE] = sequence
                sequence = (sequence + 1) & 0xFF
                if shift_us:
                    for at, width, per in stamps:
                        value = int.from_bytes(frame[at : at + width], "little")
                        if value:
                            value += shift_us // per
                            frame[at : at + width] = value.to_bytes(width, "little")
                frame += mcrf4xx(bytes(frame[1:]) + extra).to_bytes(CHECKSUM, "little")
                yield t_us + shift_us, bytes(frame)
            first = self._again
            shift_us += self._length_us


class Player:
    """Sends frames at a speed that may change."""

    def __init__(self, laps: Laps, port: int) -> None:
        self._frames = iter(laps)
        self._first_us = laps.first_us
        self._to = ("127.0.0.1", port)
        self._asked = 0.0
        self._end = False

    def run(self) -> None:
        """Until told to end."""
        threading.Thread(target=self._listen, daemon=True).start()
        sent = 0
        t_us, frame = next(self._frames)
        speed, base_us, base_s = 0.0, 0, time.monotonic()
        told_s = 0.0
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            out.connect(self._to)
            while not self._end:
                now_s = time.monotonic()
                if speed != self._asked:
                    base_us, base_s, speed = t_us, now_s, self._asked
                due_us = base_us + (now_s - base_s) * speed * 1e6
                limit = sent + 20_000
                while speed and t_us <= due_us and sent < limit:
                    out.send(frame)
                    sent += 1
                    t_us, frame = next(self._frames)
                if now_s - told_s >= TELL_S:
                    told_s = now_s
                    late_s = max(due_us - t_us, 0) * 1e-6 / speed if speed else 0.0
                    self._tell(t_us, sent, late_s)
                time.sleep(SLICE_S)
        self._tell(t_us, sent, 0.0)

    def _tell(self, t_us: int, sent: int, late_s: float) -> None:
        print(json.dumps({"t_us": self._first_us + t_us, "sent": sent, "late_s": late_s}))
        sys.stdout.flush()

    def _listen(self) -> None:
        for line in sys.stdin:
            order = json.loads(line)
            self._asked = float(order.get("speed", self._asked))
            self._end = self._end or bool(order.get("end"))
        self._end = True


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--to", type=int, required=True, metavar="PORT")
    parser.add_argument("--imus", type=int, default=4)
    parser.add_argument("--laps", type=int, default=3)
    parser.add_argument("--straight-s", type=float, default=20.0)
    arguments = parser.parse_args()
    laps = Laps(*fly(arguments.laps, arguments.imus, arguments.straight_s))
    print(json.dumps({"frames_per_s": laps.frames_per_s}), flush=True)
    Player(laps, arguments.to).run()


if __name__ == "__main__":
    main()
