"""What a newcomer is told: what happened, why, and what to do; every sentence names its remedy."""

import os
import socket
import sys
from pathlib import Path
from typing import Any

import pytest

from links.endpoints import LinkState
from links.endpoints.base import LinkCounters
from monitor.cli import invoke
from monitor.doubts import NOT_WINGED, about_flight, about_links, about_vehicle

UNUSABLE = 2


@pytest.fixture
def told(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Types a command line in an empty folder; what it is refused with, a line each."""
    monkeypatch.chdir(tmp_path)

    def typed(line: str) -> str:
        assert invoke(line.split()[1:]) == UNUSABLE
        said = capsys.readouterr()
        assert "Traceback" not in said.err
        lines = [w.removeprefix("mavsentry: ") for w in said.err.splitlines()]
        return "\n".join(w for w in lines if not w.startswith("listening on"))

    return typed


@pytest.mark.parametrize(
    ("line", "what", "remedy"),
    [
        ("mavsentry analyse x.tlog", "No such command 'analyse'", "Did you mean 'analyze'?"),
        ("mavsentry frobnicate", "'frobnicate'", "`mavsentry --help` shows what it takes"),
        ("mavsentry run --inn x", "No such option: --inn", "`mavsentry run --help`"),
        ("mavsentry analyze", "Missing argument", "`mavsentry analyze --help`"),
        ("mavsentry reproduce x --out y", "'x' is not", "`mavsentry reproduce --help`"),
        ("mavsentry run --in 0.0.0.0:14550", "is not a link", "give udpin:HOST:PORT"),
        ("mavsentry run --in udpin:0.0.0.0", "not of the form", "such as udpin:0.0.0.0:14550"),
        ("mavsentry run --in tcp:host", "not of the form", "such as tcp:127.0.0.1:5760"),
        ("mavsentry run --config s.toml", "cannot read s.toml", "`mavsentry config init` writes"),
        ("mavsentry analyze x.tlog --profile jet", "there is no profile 'jet'", "small-uav"),
        ("mavsentry feed small-uav-helthy", "no bundled scenario", "did you mean"),
        ("mavsentry key check k", "there is no k", "mavsentry key new k makes one"),
        ("mavsentry config show air.confrm_s", "there is no key", "did you mean air.confirm_s?"),
        ("mavsentry config show zz", "there is no key or section zz", "lists them all"),
    ],
)
def test_a_mistyped_line_is_answered_with_what_to_type(told, line, what, remedy) -> None:
    said = told(line)
    assert "\n" not in said
    assert what in said
    assert remedy in said


def test_a_log_that_is_none_is_said_to_be_none(told) -> None:
    for name, content, said in (
        ("empty.tlog", b"", "wrote nothing"),
        ("mission.log", b"12:00 armed\n" * 99, "is text, no flight log"),
        ("flight.log", b"FMT, 128, 89\n" * 99, "give the one that it was made of"),
        ("photo.tlog", b"\x89PNG" * 999, "no telemetry log (.tlog)"),
        ("packed.tlog", b"\x1f\x8b" * 99, "unpack it first"),
    ):
        Path(name).write_bytes(content)
        assert said in told(f"mavsentry analyze {name}")
    assert "did you mean empty.tlog?" in told("mavsentry analyze emtpy.tlog")
    assert "name the logs in it (./*.tlog)" in told("mavsentry analyze .")


def test_every_problem_of_a_file_is_listed_with_its_line(told) -> None:
    Path("s.toml").write_text('[air]\nconfirm = 2.0\n\n[publish]\nmask_rate_hz = "fast"\nair = 1\n')
    first, second, third = told("mavsentry config check s.toml").splitlines()
    assert first == "s.toml, line 2: there is no key air.confirm; did you mean confirm_s?"
    assert second.startswith("s.toml, line 5: publish.mask_rate_hz = 'fast' is text, and takes a ")
    assert third.startswith("s.toml, line 6: there is no key publish.air; air stands in the")
    said = told("mavsentry run --config s.toml --in udpin:127.0.0.1:0")
    assert said.startswith(first)
    assert "2 more problems are listed by `mavsentry config check`" in said


def test_a_key_in_the_wrong_section_is_shown_its_place(told) -> None:
    Path("s.toml").write_text("[imu]\nmargin_one = 3\n")
    assert "margin_one stands in the section [air]" in told("mavsentry config check s.toml")


def test_a_port_in_use_names_who_may_have_it(told) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        said = told(f"mavsentry run --in udpin:127.0.0.1:{other.getsockname()[1]}")
    assert "already in use: end the program that listens there (a second mavsentry" in said


def test_a_missing_extra_is_named_with_its_command(told, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "serial", None)
    assert "pip install 'mavsentry[serial]'" in told("mavsentry run --in /dev/ttyACM9:57600")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_where_nothing_can_be_written_another_place_is_asked_for(told) -> None:
    Path("closed").mkdir(mode=0o555)
    assert "--out names another" in told("mavsentry demo --out closed/out")


def link(name: str, kind: str, received: int, **more: Any) -> LinkState:
    counters = LinkCounters()
    counters.received_bytes = received
    facts: dict[str, Any] = {"open": True, "heard_us": None, "backoff_s": 0.0, "trouble": None}
    facts |= {"peers": 0} | more
    return LinkState(name=name, kind=kind, counters=counters, **facts)


@pytest.mark.parametrize(
    ("name", "received", "messages", "said"),
    [
        ("udpin:0.0.0.0:14550", 0, 0, "must send to this port of this computer"),
        ("udpout:10.0.0.1:14550", 0, 0, "is it the address of the vehicle"),
        ("/dev/ttyAMA0:57600", 0, 0, "receive and transmit are crossed"),
        ("/dev/ttyAMA0:57600", 9000, 0, "the baud rate behind the device's name"),
        ("udpin:0.0.0.0:14550", 9000, 0, "another program sends to this port"),
        ("udpin:0.0.0.0:14550", 9000, 99, "none of an autopilot's"),
    ],
)
def test_silence_and_noise_on_a_link_are_said(name, received, messages, said) -> None:
    kind = "serial" if name.startswith("/") else name.partition(":")[0]
    (sentence,) = about_links([link(name, kind, received)], 6.0, messages)
    assert said in sentence


def test_nothing_is_said_at_once_nor_of_a_link_that_is_shut() -> None:
    state = link("udpin:0.0.0.0:14550", "udpin", 0)
    assert about_links([state], 4.0, 0) == []
    assert about_links([link("tcp:a:1", "tcp", 0, open=False)], 60.0, 0) == []


def test_only_what_has_wings_is_judged_without_a_word() -> None:
    from pymavlink.dialects.v20 import common

    known = {e.name.removeprefix("MAV_TYPE_") for e in common.enums["MAV_TYPE"].values()}
    assert known >= NOT_WINGED
    assert about_vehicle("FIXED_WING") is None
    assert about_vehicle("VTOL_TILTROTOR") is None
    assert "it is a quadrotor: only fixed-wing" in str(about_vehicle("QUADROTOR"))


def test_a_flight_that_the_profile_never_saw_fly_is_said() -> None:
    def monitored(seconds: float) -> dict[str, Any]:
        grounded = {"sensor": "imu0.acc_x", "seconds": seconds}
        grounded["unmonitored"] = [{"from_s": 0, "to_s": 9, "reason": "on ground"}]
        return {
            "vehicle": {"type": "FIXED_WING"},
            "monitored": [grounded, {"sensor": "gps0", "seconds": 9.0, "unmonitored": []}],
        }

    (said,) = about_flight(monitored(0.0), "transport", 60.0)
    assert "by the profile transport it never flew (ground speed above 60 m/s" in said
    assert about_flight(monitored(5.0), "transport", 60.0) == []


def test_config_show_of_a_key_names_every_layer_and_the_one_in_force(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    file = tmp_path / "s.toml"
    file.write_text("[phase]\nflying_speed_m_s = 70.0\n")
    line = f"config show phase.flying_speed_m_s --profile transport --config {file}"
    assert invoke(line.split()) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "phase.flying_speed_m_s = 70.0"
    assert "  in flight: the MAVLink parameter FLY_SPEED" in said
    assert [row.split() for row in said[-3:]] == [
        ["default", "9.0"],
        ["profile", "transport", "60.0"],
        [str(file), "70.0", "<-", "in", "force"],
    ]
    assert invoke(["config", "show", "phase"]) == 0
    assert all(row.startswith("phase.") for row in capsys.readouterr().out.splitlines())


def test_a_commented_file_says_what_the_profile_changed(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    file = tmp_path / "s.toml"
    assert invoke(["config", "init", str(file), "--profile", "transport"]) == 0
    lines = file.read_text().splitlines()
    at = lines.index("# flying_speed_m_s = 60.0")
    assert "without the profile 9.0" in " ".join(x.removeprefix("# ") for x in lines[at - 2 : at])
