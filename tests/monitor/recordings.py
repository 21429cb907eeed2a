"""Frames to record, and recordings read back."""

from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as wire

from links.mavlink.dialect import load_dialect
from links.mavlink.framing import Framer
from monitor.recorder import whole_frames


def frames(count: int, *, signed: bool = False, system: int = 1) -> list[bytes]:
    mav = wire.MAVLink(None, srcSystem=system, srcComponent=1)
    if signed:
        mav.signing.secret_key = bytes(range(32))
        mav.signing.sign_outgoing = True
        mav.signing.timestamp = 1
    return [
        mav.attitude_encode(k, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0).pack(mav, force_mavlink1=k % 3 == 1)
        for k in range(count)
    ]


def read_back(folder: Path) -> list[tuple[bytes, int]]:
    return [record for file in recordings(folder) for record in read_back_of(file)]


def read_back_of(file: Path) -> list[tuple[bytes, int]]:
    framer = Framer(load_dialect(), stamped=True)
    out = list(whole_frames(framer.feed(file.read_bytes())))
    out += list(whole_frames(framer.finish()))
    assert framer.bad_bytes == 0
    return out


def recordings(folder: Path) -> list[Path]:
    return sorted(folder.glob("mavsentry-*.tlog"))
