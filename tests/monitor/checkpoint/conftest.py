"""A flight with every kind of sensor, in which some break, as bytes and as batches."""

from typing import NamedTuple

import pytest

from links.mavlink import Decoder
from links.samples import Batch
from monitor.pipeline import Pipeline
from monitor.publish import Publisher
from monitor.settings import load
from sim_feeds.player import frames
from sim_feeds.scenario import parse

FLIGHT = """\
title = "Two turns in which an accelerometer and a pitot break"
aircraft = "small-uav"
seed = 3

[start]
speed_m_s = 20.0
agl_m = 150.0

[[leg]]
do = "level"
duration_s = 8.0
[[leg]]
do = "turn"
angle_deg = 180.0
[[leg]]
do = "turn"
angle_deg = -180.0
[[leg]]
do = "level"
duration_s = 25.0

[[wind]]
kind = "constant"
speed_m_s = 4.0
toward_deg = 60.0

[imu]
count = 2

[airspeed]
count = {pitots}

[aoa]
count = {vanes}

[[fault]]
sensor = "imu0.acc_x"
kind = "bias"
size_m_s2 = 3.0
start_s = 25.0

[[fault]]
sensor = "airspeed0"
kind = "bias"
size_m_s = -7.0
start_s = 45.0
"""

SLICE_US = 50_000


class Monitor(NamedTuple):
    """A freshly built one."""

    decoder: Decoder
    pipeline: Pipeline
    publisher: Publisher


def monitor(settings=None) -> Monitor:
    settings = settings or load()
    return Monitor(
        Decoder(settings.links.decoder_options()), Pipeline(settings), Publisher(settings.publish)
    )


def datagrams(pitots: int, vanes: int) -> list[bytes]:
    """The flight's frames, those of :data:`SLICE_US` together."""
    out: dict[int, bytes] = {}
    for t_us, frame in frames(parse(FLIGHT.format(pitots=pitots, vanes=vanes))):
        out[t_us // SLICE_US] = out.get(t_us // SLICE_US, b"") + frame
    return [out[k] for k in sorted(out)]


def batches(data: list[bytes]) -> list[Batch]:
    """The same as rows."""
    decoder = Decoder(load().links.decoder_options())
    return [decoder.feed(part) for part in data]


@pytest.fixture(scope="session")
def pair() -> list[bytes]:
    """Two pitots and no vane: the filter bank."""
    return datagrams(2, 0)


@pytest.fixture(scope="session")
def many() -> list[bytes]:
    """Three pitots and three vanes: votes."""
    return datagrams(3, 3)
