"""The screen of ``mavsentry run``: what a pilot reads, in the room and colours that there are."""

import io
import re

import numpy as np
import pytest
from rich.console import Console

from links.vocabulary import GYRO_ACC_AXES, Kind, Reason, State
from monitor.commands import screen as screens
from monitor.commands.board import Board, Rates, View
from monitor.commands.common import note
from monitor.commands.screen import Screen, output
from monitor.commands.showing import duration, true_value
from monitor.daemon import Status
from monitor.latency import Latency
from monitor.verdict import AIR_ESTIMATE, ENGINE_ESTIMATE, IMU_ESTIMATE, StepResult, Verdict

S = 1_000_000
NOW_US = 200 * S
NONE = float("nan")

ACC_FAULT = Verdict(
    76 * S,
    "imu0.acc_x",
    State.FAULTY,
    kind=Kind.BIAS,
    onset_t_us=75 * S,
    magnitude=1.5,
    unit="m/s^2",
    evidence="GPS velocity and static pressure agree with imu1 and not with imu0",
)
PITOT_FAULT = Verdict(
    176 * S,
    "airspeed1",
    State.FAULTY,
    kind=Kind.DRIFT,
    onset_t_us=175 * S,
    magnitude=-5.5,
    unit="m/s",
    evidence="airspeed1 has read 12 % below what GPS and wind say",
)


def row(dtype, t_us=NOW_US, **values):
    rows = np.zeros(1, dtype)
    rows["t_us"] = t_us
    for name, value in values.items():
        rows[name] = value
    return rows


def newest():
    return {
        "air": row(AIR_ESTIMATE, cas_m_s=25.42, aoa_rad=np.radians(4.0))[0],
        "imu0": row(IMU_ESTIMATE, acc_m_s2=(1.251, 0, 0), gyro_rad_s=np.radians((0, 2, 0)))[0],
        "engine": row(ENGINE_ESTIMATE, speed_rpm=(5200, NONE, NONE, NONE))[0],
    }


def healthy(imus=2, pitots=2):
    names = [f"imu{i}.{axis}" for i in range(imus) for axis in GYRO_ACC_AXES]
    names += [f"airspeed{i}" for i in range(pitots)]
    return {name: Verdict(100 * S, name, State.OK) for name in names}


def status(t_us=NOW_US, silent=False, counts=0, latency=None):
    return Status(
        t_us,
        silent,
        12.3 if silent else 0.1,
        1,
        counts,
        10 * counts,
        counts // 10,
        latency or Latency(0, *[NONE] * 3),
    )


def drawn(view, width=110, height=40, whole=False, **how):
    """The picture as lines; each is as wide as was given at most."""
    page = io.StringIO()
    how = {"color_system": None, "legacy_windows": False, **how}
    console = Console(file=page, force_terminal=True, width=width, height=height, **how)
    console.print(Board(view, whole))
    lines = page.getvalue().rstrip("\n").split("\n")
    if how["color_system"] is None:
        lines = [re.sub("\x1b\\[[0-9;]*m", "", line) for line in lines]
        assert max(map(len, lines)) <= width
    assert whole or len(lines) <= height
    return [line.rstrip() for line in lines]


def view(*faults, states=None, **values):
    states = dict(healthy() if states is None else states)
    states.update({fault.sensor: fault for fault in faults})
    return View("udpin:0.0.0.0:14550", states, **{"status": status(), "newest": newest(), **values})


# -- What a glance takes in ---------------------------------------------------------------------


def test_a_fault_is_told_on_top_with_size_true_value_age_and_evidence():
    lines = drawn(view(ACC_FAULT, PITOT_FAULT))
    assert lines[1] == " 2 FAULTY: airspeed1, imu0.acc_x"
    assert " ".join(lines[3].split()) == (
        "✕ FAULTY airspeed1 25 s 5.5 m/s low, drift, true 25.4 m/s"
    )
    assert lines[4].strip() == "airspeed1 has read 12 % below what GPS and wind say"
    assert " ".join(lines[5].split()) == (
        "✕ FAULTY imu0.acc_x 2:05 1.5 m/s^2 high, bias, true 1.25 m/s^2"
    )


def test_axes_that_are_fine_are_one_line_and_the_faulty_one_another():
    text = "\n".join(drawn(view(ACC_FAULT)))
    assert re.search(r"✓ ok +imu0 5 axes +1:40", text)
    assert re.search(r"✓ ok +imu1 6 axes +1:40", text)
    assert "imu0.gyro_x" not in text


def test_all_well_is_said_with_how_many():
    assert drawn(view())[1] == " all 14 judged sensors ok"
    grounded = {
        name: Verdict(S, name, State.UNMONITORED, Reason.ON_GROUND) for name in ("aoa0", "aoa1")
    }
    lines = drawn(view(states=healthy() | grounded))
    assert lines[1] == " all 14 judged sensors ok, 2 not judged"
    assert "○ unmonitored  on ground: aoa0, aoa1" in lines


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"status": status(None)}, " nothing heard of a vehicle yet"),
        (
            {"status": status(silent=True)},
            " LINK SILENT for 12 s: states are the last known",
        ),
        ({"states": {}}, " no sensor is judged now"),
    ],
)
def test_what_cannot_be_known_is_not_called_well(changed, said):
    assert drawn(view(**changed))[1] == said


def test_a_silent_link_outranks_a_fault_and_knows_no_true_value():
    lines = drawn(view(ACC_FAULT, status=status(silent=True)))
    assert "LINK SILENT" in lines[1]
    assert "✕ FAULTY" in lines[3]
    assert "true" not in "\n".join(lines)


def test_rates_latency_and_further_facts_stand_below():
    latency = Latency(400, 4.2, 9.3, 20.0)
    lines = drawn(
        view(
            status=status(latency=latency),
            rates=Rates(141.0, 830.0, 21.0),
            beside=("recording a.tlog, 12.3 MB", "page http://127.0.0.1:8080"),
        )
    )
    assert lines[-2:] == [
        "in 141 datagrams/s, 830 samples/s · out 21/s · answers 4 ms (99 %: 9 ms) · "
        "recording a.tlog, 12.3 MB",
        "page http://127.0.0.1:8080",
    ]


# -- The room there is --------------------------------------------------------------------------


@pytest.mark.parametrize("width", [40, 60, 80, 120])
@pytest.mark.parametrize("height", [8, 12, 24, 50])
def test_faults_and_states_are_read_on_any_terminal(width, height):
    crowded = view(
        ACC_FAULT,
        PITOT_FAULT,
        states=healthy(imus=5, pitots=3),
        changes=[f"{i:9.2f} s  airspeed0     ok" for i in range(30)],
        rates=Rates(141.0, 830.0, 21.0),
        beside=("page http://127.0.0.1:8080",),
    )
    lines = drawn(crowded, width, height)  # nothing is wider or higher than that
    text = "\n".join(lines)
    assert "2 FAULTY: airspeed1, imu0.acc_x" in text
    assert re.search(r"✕ FAULTY +airspeed1", text)
    assert re.search(r"✕ FAULTY +imu0.acc_x", text)
    assert "samples/s" in text
    if height >= 12:
        assert "✓ ok" in text


def test_thirty_axes_share_a_line_where_room_is_short():
    lines = drawn(view(states=healthy(imus=5)), width=80, height=9)
    assert "✓ ok           airspeed0, airspeed1, imu0, imu1, imu2, imu3, imu4" in lines


def test_what_does_not_fit_is_counted():
    many = [
        Verdict(NOW_US, f"imu{i}.{axis}", State.FAULTY) for i in range(3) for axis in GYRO_ACC_AXES
    ]
    lines = drawn(view(*many), width=80, height=16)
    (more,) = [line for line in lines if "more that do not fit" in line]
    shown = sum(line.startswith("✕") for line in lines)
    assert more == f"  and {len(many) + 1 - shown} lines more that do not fit"


def test_the_last_picture_has_everything():
    many = [Verdict(NOW_US, f"imu{i}.acc_x", State.FAULTY) for i in range(5)]
    lines = drawn(view(*many, states=healthy(imus=5)), width=80, height=5, whole=True)
    assert sum(line.startswith("✕") for line in lines) == 5
    assert sum("5 axes" in line for line in lines) == 5


# -- Colour, and none ---------------------------------------------------------------------------


def test_a_state_is_a_colour_a_mark_and_a_word():
    coloured = "\n".join(drawn(view(ACC_FAULT), color_system="standard"))
    assert re.search("\x1b\\[1;31m✕ FAULTY", coloured)
    assert re.search("\x1b\\[32m✓ ok", coloured)


def test_no_color_leaves_words_and_no_colour_codes(monkeypatch):
    monkeypatch.setenv("NO_COLOR", "1")
    bare = "\n".join(drawn(view(ACC_FAULT), color_system="standard"))
    assert "✕ FAULTY" in bare
    assert not re.search("\x1b\\[(?:[0-9]+;)*[349][0-7]m", bare)


def test_a_terminal_without_unicode_gets_ascii():
    raw = io.BytesIO()
    page = io.TextIOWrapper(raw, encoding="ascii", write_through=True)
    console = Console(file=page, force_terminal=True, color_system=None, width=60, height=19)
    changes = [f"{i} s  airspeed0 ok" + " and so on" * 9 for i in range(20)]
    console.print(Board(view(ACC_FAULT, PITOT_FAULT, changes=changes, rates=Rates(1, 2, 3))))
    text = raw.getvalue().decode("ascii")
    assert "X FAULTY" in text
    assert "+ ok" in text
    assert "and so o..." in text


# -- Values -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sensor", "value"),
    [
        ("imu0.acc_x", "1.25 m/s^2"),
        ("imu0.gyro_y", "2.00 deg/s"),
        ("airspeed2", "25.4 m/s"),
        ("aoa0", "4.0 deg"),
        ("spool0", "5200 rpm"),
        ("spool1", ""),
        ("imu1.acc_x", ""),
        ("wing_left.lift", ""),
        ("gps0", ""),
    ],
)
def test_the_true_value_is_the_reconstructed_one_in_a_pilots_unit(sensor, value):
    assert true_value(sensor, newest(), NOW_US) == value


def test_an_old_reconstruction_is_no_true_value():
    assert true_value("airspeed0", newest(), NOW_US + 3 * S) == ""


@pytest.mark.parametrize(
    ("seconds", "text"), [(-1, "0 s"), (59.9, "59 s"), (60, "1:00"), (3725, "1:02:05")]
)
def test_durations_are_short(seconds, text):
    assert duration(seconds) == text


# -- The screen over time -----------------------------------------------------------------------


class FakeClock:
    def __init__(self, monkeypatch):
        self.now_s = 0.0
        monkeypatch.setattr(screens.time, "monotonic", lambda: self.now_s)


@pytest.fixture
def page():
    return Console(file=io.StringIO(), force_terminal=True, width=80, height=24, color_system=None)


def test_it_redraws_on_a_change_and_else_now_and_then(page, monkeypatch):
    clock = FakeClock(monkeypatch)
    asked = []

    def counts():
        asked.append(clock.now_s)
        return status(counts=round(100 * clock.now_s))

    quiet, change = StepResult(), StepResult([ACC_FAULT], {"imu0": row(IMU_ESTIMATE)})
    with Screen(page, "udp") as screen:
        for clock.now_s in (0.0, 0.1, 0.2, 0.6, 0.7):
            screen.show(quiet, {}, counts)
        assert asked == [0.0, 0.6]
        clock.now_s = 0.8
        screen.show(change, {"imu0.acc_x": ACC_FAULT}, counts)
        assert asked[-1] == 0.8
        assert "100 datagrams/s, 1000 samples/s" in page.file.getvalue()


def test_rates_are_those_of_the_last_seconds(page, monkeypatch):
    clock = FakeClock(monkeypatch)
    with Screen(page, "udp") as screen:
        for second in range(10):
            clock.now_s = float(second)
            now = status(counts=50 * min(second, 5))
            screen.show(StepResult(), {}, lambda now=now: now)
        page.file.seek(0)
        page.file.truncate()
        clock.now_s = 10.0
        screen.show(StepResult(), {}, lambda: status(counts=250))
        assert "in 0 datagrams/s" in page.file.getvalue()


def test_it_leaves_the_other_page_shows_the_cursor_and_the_last_picture(page):
    with Screen(page, "udp") as screen:
        screen.show(StepResult([ACC_FAULT]), {"imu0.acc_x": ACC_FAULT}, status)
    written = page.file.getvalue()
    left = written.index("\x1b[?1049l")
    assert written.index("\x1b[?1049h") < left
    assert written.rindex("\x1b[?25h") > written.rindex("\x1b[?25l")
    assert "1 FAULTY: imu0.acc_x" in written[left:]
    assert "newest changes" in written[left:]


def test_the_last_picture_is_of_the_end(page, monkeypatch):
    clock = FakeClock(monkeypatch)
    with Screen(page, "udp") as screen:
        screen.show(StepResult(), {}, lambda: status(100 * S))
        clock.now_s = 0.1
        screen.show(StepResult(), {}, lambda: status(130 * S))
    assert "vehicle time 2:10" in page.file.getvalue().rpartition("\x1b[?1049l")[2]


def test_notes_are_shown_among_the_changes_and_said_at_the_end(page, capsys):
    with Screen(page, "udp") as screen:
        note("mavsentry: cannot record any more")
        screen.show(StepResult([ACC_FAULT]), {"imu0.acc_x": ACC_FAULT}, status)
        assert "cannot record any more" in page.file.getvalue()
        assert capsys.readouterr().err == ""
    assert capsys.readouterr().err == "mavsentry: cannot record any more\n"


def test_a_failure_leaves_the_terminal_clean_too(page):
    with pytest.raises(KeyError), Screen(page, "udp"):
        raise KeyError
    assert "\x1b[?1049l" in page.file.getvalue()


def test_without_a_terminal_each_change_is_a_line(capsys):
    with output(False, "udp") as show:
        show(StepResult([ACC_FAULT]), {}, status)
        show(StepResult(), {}, status)
    (line,) = capsys.readouterr().out.splitlines()
    assert line.split()[:4] == ["76.00", "s", "imu0.acc_x", "FAULTY"]
    assert "\x1b" not in line


def test_json_lines_are_chosen_over_any_screen(capsys):
    with output(True, "udp") as show:
        show(StepResult([ACC_FAULT]), {}, status)
    assert capsys.readouterr().out.startswith('{"t_us": 76000000, "sensor": "imu0.acc_x"')
