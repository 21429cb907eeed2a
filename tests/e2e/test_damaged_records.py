"""On-board logs as they come, .BIN and .ulg: cut, flipped, gapped, of several boots, clocks astray.

As of telemetry logs in ``test_damaged_logs``: what was broken is found and nothing else is blamed.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from links.logs import LogError
from monitor.analyze import Analysis, analyze_log
from monitor.cli import invoke
from monitor.settings import load
from sim_feeds.dataflash import ardupilot_log
from sim_feeds.scenario import load as load_scenario
from sim_feeds.ulog import px4_log
from tests.links.mutations import Sound, bin_of, ulg_of

from .damage import flipped
from .test_damaged_logs import FAULT, FLIGHT, fly, garbage

MIDDLE_S = 75.0
FORMATS = ("BIN", "ulg")


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, bool], Sound]:
    """The flight as a log of a format, healthy or with a pitot that reads low from 90 s on."""

    @cache
    def flight(broken: bool) -> object:
        file = tmp_path_factory.mktemp("flight") / "flight.toml"
        file.write_text(FLIGHT + (FAULT if broken else ""))
        return load_scenario(file).fly()

    @cache
    def log(form: str, broken: bool) -> Sound:
        if form == "BIN":
            return bin_of(form, ardupilot_log(flight(broken)).content())
        return ulg_of(form, px4_log(flight(broken)).content())

    return log


@pytest.fixture
def analyzed(tmp_path: Path) -> Callable[[str, bytes], Analysis]:
    """Analysis of a log of these bytes."""

    def analyze(form: str, data: bytes) -> Analysis:
        file = tmp_path / f"log.{form}"
        file.write_bytes(data)
        return analyze_log(file, load())

    return analyze


def begins(log: Sound) -> tuple[np.ndarray, np.ndarray]:
    """Where each stamped record begins, and its time since the first [s]."""
    head = 5 if log.name == "ulg" else 3
    at = np.array([place for place, _ in log.stamps])
    t_us = np.array([struct.unpack_from("<Q", log.data, int(a))[0] for a in at])
    return at - head, (t_us - t_us[0]) / 1e6


def upto(log: Sound, t_s: float) -> int:
    """Where the records of a time begin."""
    at, told_s = begins(log)
    return int(at[np.argmax(told_s >= t_s)])


def sampled(log: Sound) -> set[int]:
    """Numbers of ULog topics whose second field is the time of the sample."""
    numbers, names, at = set(), set(), 16
    while log.name == "ulg" and (kind := log.data[at + 2 : at + 3]) != b"D":
        size = int.from_bytes(log.data[at : at + 2], "little")
        name, _, fields = log.data[at + 3 : at + 3 + size].partition(b":")
        if kind == b"F" and fields.startswith(b"uint64_t timestamp;uint64_t timestamp_sample;"):
            names.add(name)
        if kind == b"A" and name[3:] in names:
            numbers.add(int.from_bytes(name[1:3], "little"))
        at += 3 + size
    return numbers


def retimed(log: Sound, clock: Callable[[float], float]) -> bytes:
    """The log of a vehicle whose clock shows ``clock(t_s)`` at ``t_s`` of the flight."""
    data, both = bytearray(log.data), sampled(log)
    (first,) = struct.unpack_from("<Q", data, log.stamps[0][0])
    for at, _ in log.stamps:
        number = int.from_bytes(data[at - 2 : at], "little")
        for place in (at, at + 8) if log.name == "ulg" and number in both else (at,):
            (t_us,) = struct.unpack_from("<Q", data, place)
            new_s = clock((t_us - first) / 1e6)
            struct.pack_into("<Q", data, place, first + round(new_s * 1e6))
    return bytes(data)


def stepped(log: Sound, by_s: float) -> bytes:
    return retimed(log, lambda t: t + by_s if t >= MIDDLE_S else t)


def without(log: Sound, length_s: float) -> bytes:
    """Nothing was written for a while."""
    return log.data[: upto(log, MIDDLE_S)] + log.data[upto(log, MIDDLE_S + length_s) :]


def stamps_hit(log: Sound) -> bytes:
    """A bit of one stamp in a thousand is wrong."""
    data, rng = bytearray(log.data), np.random.default_rng(3)
    for k in rng.choice(len(log.stamps), len(log.stamps) // 1000, replace=False).tolist():
        data[log.stamps[k][0] + int(rng.integers(2, 8))] ^= 1 << int(rng.integers(8))
    return bytes(data)


def in_the_middle(log: Sound, what: bytes) -> bytes:
    at = upto(log, MIDDLE_S) + 7
    return log.data[:at] + what + log.data[at:]


DAMAGES: dict[str, Callable[[Sound], bytes]] = {
    "cut off in a record": lambda log: log.data[: int(0.9 * len(log.data)) + 5],
    "garbage before it": lambda log: garbage(4321) + log.data,
    "garbage in it": lambda log: in_the_middle(log, garbage(50_000)),
    "zeros in it": lambda log: in_the_middle(log, bytes(50_000)),
    "a piece of itself in it": lambda log: in_the_middle(log, log.data[-30_001:-1]),
    "bits flipped": lambda log: flipped_behind(log, 1e-5),
    "stamps hit": stamps_hit,
    "a gap of 1 s": lambda log: without(log, 1.0),
    "a gap of 10 s": lambda log: without(log, 10.0),
    "the clock 100 s ahead": lambda log: stepped(log, 100.0),
    "the clock a day ahead": lambda log: stepped(log, 86_400.0),
    "the clock a year ahead": lambda log: stepped(log, 3.2e7),
    "the clock 2 s back": lambda log: stepped(log, -2.0),
    "the clock 50 s back": lambda log: stepped(log, -50.0),
    "a fast clock": lambda log: retimed(log, lambda t: 1.005 * t),
    "a slow clock": lambda log: retimed(log, lambda t: 0.995 * t),
}


def flipped_behind(log: Sound, share: float) -> bytes:
    """Bits flipped in the records; in what describes them they cost whole sensors."""
    at = begins(log)[0][0]
    return log.data[:at] + flipped(log.data[at:], share)


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("damage", DAMAGES)
def test_a_broken_pitot_and_nothing_else_is_found(damage, form, flown, analyzed) -> None:
    analysis = analyzed(form, DAMAGES[damage](flown(form, True)))
    blamed = [(f["sensor"], f["evidence"]) for f in analysis.faults]
    assert [x for x in blamed if x[0] != "airspeed0"] == []
    assert blamed
    assert 50.0 < analysis.summary["log"]["duration_s"] < 4e7


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize(
    "damage", ["garbage in it", "a gap of 10 s", "stamps hit", "the clock 50 s back"]
)
def test_a_healthy_flight_stays_healthy_and_is_judged(damage, form, flown, analyzed) -> None:
    whole = sum(m["seconds"] for m in analyzed(form, flown(form, False).data).summary["monitored"])
    analysis = analyzed(form, DAMAGES[damage](flown(form, False)))
    assert [(f["sensor"], f["evidence"]) for f in analysis.faults] == []
    assert sum(m["seconds"] for m in analysis.summary["monitored"]) > 0.6 * whole
    log = analysis.summary["log"]
    assert len(log["boots_s"]) == (damage == "the clock 50 s back")
    assert len(log["gaps"]) == (damage == "a gap of 10 s" and form == "BIN")


def test_two_logs_in_one_file_are_two_boots(flown, analyzed) -> None:
    log = flown("BIN", True)
    lasted_s = begins(log)[1][-1]
    later = retimed(log, lambda t: t + lasted_s + 2.0)
    for second in (log.data, later):
        analysis = analyzed("BIN", log.data + second)
        assert {f["sensor"] for f in analysis.faults} == {"airspeed0"}
        assert len(analysis.summary["log"]["boots_s"]) == (second is log.data)


def test_what_a_log_is_its_content_tells(flown, analyzed, tmp_path) -> None:
    content = {form: flown(form, False).data for form in FORMATS}
    content["tlog"] = fly(FLIGHT, tmp_path)
    for form, data in content.items():
        for name in content:
            assert analyzed(name, data[:400_000]).summary["log"]["format"] == form.lower()


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize(
    "content",
    [b"", b"\0" * 50_000, b"nothing but words, " * 4000, garbage(50_000), b"\xa3\x95\x80"],
    ids=["empty", "zeros", "words", "noise", "one header"],
)
def test_what_is_no_log_is_refused_in_one_sentence(form, content, tmp_path, capsys) -> None:
    file = tmp_path / f"x.{form}"
    file.write_bytes(content)
    assert invoke(["analyze", str(file), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr()
    assert (said.out, said.err.count("\n")) == ("", 1)
    assert str(file) in said.err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("form", FORMATS)
def test_a_log_of_definitions_alone_is_refused(form, flown, analyzed) -> None:
    log = flown(form, False)
    with pytest.raises(LogError, match="no data of a vehicle"):
        analyzed(form, log.data[: begins(log)[0][0]])


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
@pytest.mark.parametrize("form", FORMATS)
def test_a_log_that_may_not_be_read_is_refused(form, tmp_path, capsys) -> None:
    file = tmp_path / f"x.{form}"
    file.write_bytes(b"x")
    file.chmod(0)
    assert invoke(["analyze", str(file), "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err == f"mavsentry: cannot read {file}: Permission denied\n"
