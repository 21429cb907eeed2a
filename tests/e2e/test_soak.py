"""The soak in short, its flight, and that its judgement can fail."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

from links.mavlink import Decoder
from links.mavlink.dialect import load_dialect
from links.mavlink.framing import Framer

from .flood import flood
from .long_flight import Laps, fly
from .soak import Sample, arguments_of, soak, verdict

GOOD = Sample(
    at_s=0.0,
    flown_s=0.0,
    speed=1.0,
    memory_mb=200.0,
    cpu=0.3,
    behind_s=0.04,
    queue_kb=1.0,
    lost=0,
    gap_s=1.05,
    late_s=0.0,
    latency_ms=(20.0, 40.0),
)


@pytest.fixture(scope="module")
def laps():
    return Laps(*fly(laps=1, imus=1, straight_s=5.0))


def test_laps_follow_each_other_without_a_seam(laps):
    lap = laps._stop - laps._again
    frames = [frame for _, frame in islice(laps, laps._again + 3 * lap)]
    framer = Framer(load_dialect())
    found = framer.feed(b"".join(frames))
    assert (len(found), framer.bad_bytes) == (len(frames), 0)
    assert set(np.diff(found.sequence) % 256) == {1}
    rows = Decoder().feed(b"".join(frames)).rows
    for sensor, rate_hz in (("imu0", 200.0), ("attitude", 10.0), ("airspeed0", 10.0)):
        t_us = rows[sensor]["t_us"]
        step_us = np.diff(t_us)
        assert step_us.min() > 0
        assert step_us.max() <= 2.2e6 / rate_hz
        assert len(t_us) == pytest.approx((t_us[-1] - t_us[0]) * 1e-6 * rate_hz, rel=0.01)
    yaw_step = np.abs(np.diff(np.unwrap(rows["imu0"]["gyro_rad_s"][:, 2])))
    assert yaw_step.max() < 0.1


def test_a_short_soak_holds():
    given = "--minutes 0.2 --speed 6 --imus 4 --laps 1 --straight-s 4 --sample-s 2 --grown-mb 30"
    said = []
    figures, _ = soak(arguments_of(given.split()), said.append)
    assert figures["flown_s"] > 50, said
    assert figures["lost"] == 0, said
    assert figures["faults"] == 0, said
    assert figures["heartbeats"] >= 12, said
    assert figures["longest_gap_s"] < 2.5, said  # beside other tests: a loaded machine


@pytest.mark.parametrize(
    ("change", "sent", "longest_s", "faults", "said"),
    [
        ({}, 1000, 1.1, 0, ""),
        ({"memory_mb": 220.0}, 1000, 1.1, 0, "memory grew by 20.0 MB"),
        ({"behind_s": 0.8}, 1000, 1.1, 0, "0.80 s behind"),
        ({}, 1007, 1.1, 0, "7 of 1007 datagrams were lost"),
        ({}, 1000, 1.6, 0, "1.60 s without a heartbeat"),
        ({}, 1000, 1.1, 2, "2 faults announced"),
    ],
)
def test_what_does_not_hold_is_said(change, sent, longest_s, faults, said):
    samples = [GOOD] * 40 + [replace(GOOD, **change)] * 10
    wrong = verdict(samples, sent, 1000, longest_s, faults, grown_mb=8.0)
    assert wrong == ([said] if said else [])


def test_a_flood_beside_a_flight_costs_no_sample():
    said = []
    figures = flood(20_000.0, 500, 4.0, said.append)
    assert figures["junk_per_s"] > 5_000, said
    assert figures["rows_lost"] == 0, said
    assert figures["faults"] == 0, said
    assert figures["longest_gap_s"] < 2.5, said
