"""Texts for a pilot: wording, length, pace and folding."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from links.vocabulary import GYRO_ACC_AXES, Kind, Reason, State
from monitor.announce import TEXT_MAX, Announcer, understood, wording
from monitor.verdict import Verdict

S = 1_000_000


def faulty(sensor: str, magnitude: float = math.nan, unit: str = "", **extra) -> Verdict:
    return Verdict(
        t_us=10 * S, sensor=sensor, state=State.FAULTY, magnitude=magnitude, unit=unit, **extra
    )


@pytest.mark.parametrize(
    ("verdict", "text"),
    [
        (
            faulty("airspeed0", -3.14, "m/s", onset_t_us=8 * S),
            "airspeed0 FAULTY: 3.1 m/s low since 12 s",
        ),
        (
            faulty("imu0.gyro_z", 0.1, "rad/s", onset_t_us=0),
            "imu0.gyro_z FAULTY: 5.7 deg/s high since 20 s",
        ),
        (faulty("aoa2", 0.05, "rad"), "aoa2 FAULTY: 2.9 deg high"),
        (faulty("aoa1", 0.1, "rad", kind=Kind.STUCK), "aoa1 FAULTY: stuck"),
        (Verdict(0, "airspeed1", State.STALE), "airspeed1 STALE: its data stopped"),
        (Verdict(0, "airspeed1", State.OK), "airspeed1 ok"),
        (
            Verdict(0, "imu0.acc_x", State.UNMONITORED, Reason.ON_GROUND),
            "imu0.acc_x not judged: on ground",
        ),
    ],
)
def test_wording_and_what_is_understood_of_it(verdict, text):
    assert wording(verdict, 20 * S) == text
    assert understood(text) == {verdict.sensor: verdict.state}


@pytest.mark.parametrize(
    ("text", "states"),
    [
        (
            "FAULTY: airspeed0 imu0.acc_x .acc_y +3",
            dict.fromkeys(["airspeed0", "imu0.acc_x", "imu0.acc_y"], State.FAULTY),
        ),
        ("ok: imu1 aoa0", dict.fromkeys([*(f"imu1.{a}" for a in GYRO_ACC_AXES), "aoa0"], State.OK)),
        ("engine0 STOPPED: no power since 2 s", {"engine0": State.STOPPED}),
        ("imu0/imu1 gyro_x disagree", {}),
        ("FAULTY: gyro_x .acc_x", {}),
        ("PreArm: airspeed0 FAULTY", {}),
        ("Airspeed sensor 1 now OK. Re-enabled", {}),
        ("", {}),
    ],
)
def test_folded_texts_are_understood_and_others_are_not(text, states):
    assert understood(text) == states


SENSORS = [f"imu{i}.{a}" for i in range(5) for a in GYRO_ACC_AXES] + [
    *(f"airspeed{i}" for i in range(3)),
    *(f"aoa{i}" for i in range(3)),
    "wing_right.drag",
]


@given(
    st.lists(
        st.builds(
            Verdict,
            t_us=st.integers(0, 10**12),
            sensor=st.sampled_from(SENSORS),
            state=st.sampled_from(State),
            reason=st.sampled_from(Reason),
            kind=st.sampled_from(Kind),
            magnitude=st.floats(),
            unit=st.sampled_from(["m/s", "rad", "rad/s", "m/s^2", "rpm"]),
            onset_t_us=st.none() | st.integers(0, 10**12),
        ),
        max_size=60,
    )
)
def test_any_changes_make_short_ascii_texts_at_a_bounded_pace(changes):
    announcer = Announcer(burst=3, interval_s=2.0)
    texts, newest = [], {}
    for k, change in enumerate(changes):
        announcer.note(change)
        newest[change.sensor] = change.state
        said = announcer.due(k * S // 10, 10**12)
        for text in said:
            assert understood(text.text).items() <= newest.items()
        texts += said
    assert len(texts) <= 3 + len(changes) * 0.1 / 2.0 + 1
    for text in texts:
        assert 0 < len(text.text) <= TEXT_MAX
        assert text.text.isascii()


def test_many_faults_are_folded_and_none_is_forgotten():
    announcer = Announcer(burst=2, interval_s=2.0)
    sensors = [f"imu0.{a}" for a in GYRO_ACC_AXES[:5]] + ["airspeed0", "airspeed1"]
    for sensor in sensors:
        announcer.note(faulty(sensor, 1.0, "m/s"))
    (text,) = announcer.due(0, 0)
    assert text.text == "FAULTY: airspeed0 airspeed1 imu0.acc_x .acc_y +3"
    assert not announcer.due(100 * S, 0)


def test_of_one_sensor_only_the_newest_state_is_said():
    announcer = Announcer(burst=1, interval_s=2.0)
    announcer.note(faulty("aoa0", 0.1, "rad"))
    assert [t.text for t in announcer.due(0, 0)] == ["aoa0 FAULTY: 5.7 deg high"]
    announcer.note(faulty("airspeed0", 1.0, "m/s"))
    announcer.note(Verdict(0, "airspeed0", State.OK))
    assert not announcer.due(S, 0)
    assert [t.text for t in announcer.due(2 * S, 0)] == ["airspeed0 ok"]


def test_the_gravest_goes_first():
    announcer = Announcer(burst=1, interval_s=1.0)
    announcer.note(Verdict(0, "aoa0", State.OK))
    announcer.note(Verdict(0, "airspeed1", State.STALE))
    announcer.note(faulty("airspeed0", 1.0, "m/s"))
    said = [t.text.split()[0] for k in range(3) for t in announcer.due(k * S, 0)]
    assert said == ["airspeed0", "airspeed1", "aoa0"]


def test_suspicion_and_learning_are_not_announced():
    announcer = Announcer(burst=5, interval_s=1.0)
    announcer.note(Verdict(0, "aoa0", State.UNMONITORED, Reason.LEARNING))
    announcer.note(Verdict(0, "aoa0", State.SUSPECT))
    assert not announcer.due(0, 0)


def disagree(*sensors: str) -> list[Verdict]:
    return [Verdict(0, s, State.SUSPECT, Reason.SENSORS_DISAGREE) for s in sensors]


@pytest.mark.parametrize(
    ("axes", "text"),
    [
        (["gyro_x"], "imu0/imu1 gyro_x disagree"),
        (["acc_x", "gyro_y"], "imu0/imu1 acc_x gyro_y disagree"),
        (list(GYRO_ACC_AXES), "imu0/imu1 disagree on 6 axes"),
    ],
)
def test_imus_that_disagree_are_said_together_and_once(axes, text):
    announcer = Announcer(burst=5, interval_s=1.0)
    for _ in range(2):
        for verdict in disagree(*(f"imu{i}.{a}" for i in (0, 1) for a in axes)):
            announcer.note(verdict)
        said = announcer.due(0, 0)
        assert [t.text for t in said] == ([text] if text else [])
        text = ""


def test_of_two_that_disagree_one_may_have_been_said_too_often():
    announcer = Announcer(burst=5, interval_s=1.0)
    announcer.note(*disagree("airspeed1"))
    assert [t.text for t in announcer.due(0, 0)] == ["airspeed1 disagrees"]


def test_who_is_named_later_is_said_and_the_other_is_cleared():
    announcer = Announcer(burst=5, interval_s=1.0)
    for verdict in disagree("imu0.gyro_x", "imu1.gyro_x"):
        announcer.note(verdict)
    announcer.due(0, 0)
    announcer.note(faulty("imu0.gyro_x", 0.1, "rad/s"))
    announcer.note(Verdict(0, "imu1.gyro_x", State.OK))
    said = [t.text for t in announcer.due(0, 0)]
    assert said == ["imu0.gyro_x FAULTY: 5.7 deg/s high", "imu1.gyro_x ok"]


def test_the_end_of_an_alarm_is_announced_whatever_follows():
    announcer = Announcer(burst=5, interval_s=1.0)
    announcer.note(faulty("aoa0"))
    announcer.due(0, 0)
    announcer.note(Verdict(0, "aoa0", State.UNMONITORED, Reason.ON_GROUND))
    assert [t.text for t in announcer.due(0, 0)] == ["aoa0 not judged: on ground"]


def test_an_imu_that_is_watched_on_all_axes_is_said_in_one_word():
    announcer = Announcer(burst=5, interval_s=1.0)
    for sensor in ["airspeed0", *(f"imu1.{a}" for a in GYRO_ACC_AXES), "imu0.gyro_x"]:
        announcer.note(Verdict(0, sensor, State.OK))
    assert [t.text for t in announcer.due(0, 0)] == ["ok: airspeed0 imu0.gyro_x imu1"]


def test_a_sensor_that_goes_back_and_forth_does_not_flood():
    announcer = Announcer(burst=4, interval_s=2.0)
    said = []
    for k in range(1200):  # ten minutes, a change every five seconds
        if k % 10 == 0:
            sound = k % 20 != 0
            announcer.note(
                Verdict(k * S // 2, "airspeed0", State.OK)
                if sound
                else faulty("airspeed0", -3.1, "m/s")
            )
        if k == 305:  # another sensor is said at once all the same
            announcer.note(faulty("imu0.acc_x", 1.5, "m/s^2"))
        said += [(k / 2, t.text) for t in announcer.due(k * S // 2, k * S // 2)]
    of_pitot = [(t, text) for t, text in said if text.startswith("airspeed0")]
    assert [t for t, _ in of_pitot[:4]] == [0, 5, 10, 15]
    minutes = [[t for t, _ in of_pitot if m * 60 <= t < m * 60 + 60] for m in range(10)]
    assert max(map(len, minutes)) <= 4
    assert any("(x" in text for _, text in of_pitot)
    assert all(understood(text).keys() == {"airspeed0"} for _, text in of_pitot)
    assert (152.5, "imu0.acc_x FAULTY: 1.5 m/s^2 high") in said
    assert of_pitot[-1][1].startswith(("airspeed0 ok", "airspeed0 FAULTY"))


def test_the_last_state_of_a_sensor_that_toggled_is_said_in_the_end():
    announcer = Announcer(burst=4, interval_s=2.0)
    said = []
    for k in range(7):
        announcer.note(
            Verdict(k * S, "airspeed0", State.OK) if k % 2 else faulty("airspeed0", -3.1, "m/s")
        )
        said += announcer.due(k * S, k * S)
    assert len(said) == 4
    for k in range(7, 90):
        said += announcer.due(k * S, k * S)
    assert [t.text for t in said[3:]] == ["airspeed0 ok", "airspeed0 FAULTY: 3.1 m/s low (x3)"]
    announcer.note(Verdict(90 * S, "airspeed0", State.OK))
    assert [t.text for t in announcer.due(90 * S, 90 * S)] == ["airspeed0 ok"]
