"""What a monitor published is read back as the episodes that it meant, and set beside replay."""

from collections.abc import Iterable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from links.samples import WORD
from links.vocabulary import Kind, Reason, State
from monitor.masks import ENGINES, FAULT, MONITORED, SENSORS
from monitor.publish import Message, Publisher
from monitor.readback import MONITORS, ReadBack
from monitor.settings.publish import PublishSettings
from monitor.verdict import StepResult, Verdict

S = 1_000_000
OURS, THEIRS, FOREIGN = 191, 192, 158


def verdict(t_s: float, sensor: str, state: State, **extra) -> Verdict:
    return Verdict(round(t_s * S), sensor, state, **extra)


HEALTHY = [verdict(1.0, f"airspeed{i}", State.OK) for i in range(2)]
BROKEN = verdict(
    60.0, "airspeed0", State.FAULTY, kind=Kind.BIAS, onset_t_us=58 * S, magnitude=-3.1, unit="m/s"
)
MENDED = verdict(90.0, "airspeed0", State.OK)


def publish(
    verdicts: list[Verdict], from_s: float = 0.0, to_s: float = 120.0
) -> list[tuple[int, Message]]:
    """What goes out of a daemon that heard these verdicts 0.3 s after they were due."""
    publisher, waiting, sent = Publisher(PublishSettings()), list(verdicts), []
    for t_us in range(round(from_s * S), round(to_s * S), 50_000):
        now = [v for v in waiting if v.t_us + 300_000 <= t_us]
        waiting = waiting[len(now) :]
        publisher.note(StepResult(now))
        sent += [(t_us, m) for m in publisher.due(t_us, t_us, False)]
    return sent


def words(sent: list[tuple[int, Message]], component: int = OURS, system: int = 1) -> np.ndarray:
    out = np.zeros(len(sent), WORD)
    out["system"], out["component"] = system, component
    for k, (t_us, message) in enumerate(sent):
        out["t_us"][k] = t_us
        for name in set(message.fields) & {"name", "value", "text"}:
            value = message.fields[name]
            out[name][k] = value.encode() if isinstance(value, str) else value
    return out[(out["name"] != b"") | (out["text"] != b"")]


def fault(isolated_s: float, cleared_s: float | None = None, sensor: str = "airspeed0") -> dict:
    return {"sensor": sensor, "isolated_s": isolated_s, "cleared_s": cleared_s}


def read_back(parts: Iterable[np.ndarray], replayed: Iterable[dict] = (), system: int = 1):
    back = ReadBack(OURS)
    for part in parts:
        back.add(part)
    return back.summary(system, 0, replayed)


def test_a_fault_is_found_live_and_in_replay_with_its_delay_and_cause() -> None:
    heard = words(publish([*HEALTHY, BROKEN, MENDED]))
    live = read_back([heard], [fault(60.0, 90.0)])
    (monitor,), (line,) = live["monitors"], live["faults"]
    assert (monitor["component_id"], monitor["silent"]) == (OURS, [])
    assert monitor["to_s"] == pytest.approx(120.0, abs=1.0)
    assert (line["sensor"], line["state"], line["agreement"]) == ("airspeed0", "faulty", "both")
    assert line["delay_s"] == pytest.approx(0.3, abs=0.1)
    assert line["live_cleared_s"] == pytest.approx(90.3, abs=0.1)
    assert line["replay_cleared_s"] == 90.0
    assert line["said"] == "airspeed0 FAULTY: 3.1 m/s low since 2 s"
    assert not line["standing"]


@pytest.mark.parametrize("size", [1, 7, 400])
def test_where_the_words_are_cut_changes_nothing(size) -> None:
    verdicts = [*HEALTHY, BROKEN, verdict(70.0, "airspeed0", State.STALE), BROKEN, MENDED]
    heard = words(publish(verdicts))
    parts = [heard[k : k + size] for k in range(0, len(heard), size)]
    assert read_back(parts, [fault(60.0)]) == read_back([heard], [fault(60.0)])


@pytest.mark.parametrize("seed", range(5))
def test_with_half_of_the_words_lost_the_same_is_read(seed) -> None:
    heard = words(publish([*HEALTHY, BROKEN, MENDED]))
    kept = heard[np.random.default_rng(seed).random(len(heard)) < 0.5]
    (line,) = read_back([kept], [fault(60.0, 90.0)])["faults"]
    assert line["agreement"] == "both"
    assert 0.0 < line["delay_s"] < 4.0
    assert line["live_cleared_s"] == pytest.approx(90.3, abs=4.0)


@pytest.mark.parametrize(
    "between",
    [
        verdict(70.0, "airspeed0", State.STALE),
        verdict(70.0, "airspeed0", State.UNMONITORED, reason=Reason.ON_GROUND),
    ],
)
def test_who_cannot_be_judged_stays_faulty_until_it_is_sound(between) -> None:
    live = read_back([words(publish([*HEALTHY, BROKEN, between, MENDED]))], [fault(60.0, 90.0)])
    (line,) = live["faults"]
    assert line["live_cleared_s"] == pytest.approx(90.3, abs=0.6)
    open_end = read_back([words(publish([*HEALTHY, BROKEN, between]))], [fault(60.0)])
    assert open_end["faults"][0]["live_cleared_s"] is None


@pytest.mark.parametrize("size", [1, 5, 10_000])
def test_who_was_sound_again_is_cleared_whatever_follows(size) -> None:
    landed = verdict(100.0, "airspeed0", State.UNMONITORED, reason=Reason.ON_GROUND)
    heard = words(publish([*HEALTHY, BROKEN, MENDED, landed]))
    parts = [heard[k : k + size] for k in range(0, len(heard), size)]
    (line,) = read_back(parts, [fault(60.0, 90.0)])["faults"]
    assert line["live_cleared_s"] == pytest.approx(90.3, abs=0.1)


def test_a_log_that_ends_with_a_flag_taken_back_ends_cleared() -> None:
    heard = words(publish([*HEALTHY, BROKEN, MENDED]))
    last = np.flatnonzero((heard["name"] == b"FLT_AIR") & (heard["t_us"] > 90 * S))
    back = last[heard["value"][last] == 0.0][0]
    (line,) = read_back([heard[: back + 1]], [fault(60.0, 90.0)])["faults"]
    assert line["live_cleared_s"] == pytest.approx(90.3, abs=0.1)


def test_the_mask_says_when_and_the_first_text_why() -> None:
    worse = verdict(75.0, "airspeed0", State.FAULTY, magnitude=-9.0, unit="m/s")
    verdicts = [*HEALTHY, BROKEN, verdict(70.0, "airspeed0", State.STALE), worse]
    heard = words(publish(verdicts))
    lost = (heard["name"] == b"FLT_AIR") & (abs(heard["t_us"] - 60.6 * S) < 0.5 * S)
    (line,) = read_back([heard[~lost]], [fault(60.0)])["faults"]
    assert 61.0 < line["live_s"] < 61.7
    assert line["said"] == "airspeed0 FAULTY: 3.1 m/s low since 2 s"


def test_a_fault_that_flickers_live_is_one() -> None:
    pause = [verdict(65.0, "airspeed0", State.OK), verdict(69.0, "airspeed0", State.FAULTY)]
    apart = [verdict(80.0, "airspeed0", State.OK), verdict(90.0, "airspeed0", State.FAULTY)]
    heard = words(publish([*HEALTHY, BROKEN, *pause, *apart]))
    alone = read_back([heard])["faults"]
    assert [line["live_s"] for line in alone] == pytest.approx([60.3, 90.3], abs=0.1)
    assert alone[0]["live_cleared_s"] == pytest.approx(80.3, abs=0.1)
    (line,) = read_back([heard], [fault(60.0, 100.0)])["faults"]
    assert line["agreement"] == "both"


def test_a_log_that_begins_after_the_fault_says_that_it_stood_before() -> None:
    heard = words(publish([*HEALTHY, BROKEN]))
    (line,) = read_back([heard[heard["t_us"] > 80 * S]], [fault(85.0)])["faults"]
    assert (line["agreement"], line["standing"], line["delay_s"]) == ("both", True, None)
    assert line["live_s"] == pytest.approx(80.0, abs=1.0)


def test_a_monitor_that_was_started_anew_was_silent_between() -> None:
    learning = [verdict(100.0, "airspeed0", State.UNMONITORED, reason=Reason.LEARNING)]
    again = publish([*learning, verdict(110.0, "airspeed0", State.OK)], 100.0, 130.0)
    heard = words(publish([*HEALTHY, BROKEN], to_s=80.0) + again)
    live = read_back([heard], [fault(60.0, 112.0)])
    (silent,) = live["monitors"][0]["silent"]
    assert silent["from_s"] == pytest.approx(80.0, abs=1.0)
    assert silent["to_s"] == pytest.approx(100.3, abs=1.0)
    (line,) = live["faults"]
    assert line["live_cleared_s"] == pytest.approx(110.3, abs=1.0)


def test_what_only_one_of_both_found_is_told_and_whether_the_monitor_spoke() -> None:
    heard = words(publish([*HEALTHY, BROKEN, MENDED], to_s=100.0))
    heard = heard[(heard["t_us"] < 30 * S) | (heard["t_us"] > 50 * S)]
    elsewhere = [
        fault(20.0, 25.0, "airspeed1"),
        fault(35.0, 40.0, "airspeed1"),
        fault(150.0, None, "airspeed1"),
    ]
    lines = read_back([heard], elsewhere)["faults"]
    assert [(line["sensor"], line["agreement"]) for line in lines] == [
        ("airspeed1", "replay only"),
        ("airspeed1", "not heard"),
        ("airspeed0", "live only"),
        ("airspeed1", "not heard"),
    ]
    assert lines[2]["replay_s"] is None
    assert lines[3]["live_s"] is None


def test_two_monitors_are_told_apart() -> None:
    mine, other = words(publish([*HEALTHY, BROKEN])), words(publish(HEALTHY), THEIRS)
    both = np.concatenate([mine, other])
    live = read_back([both[np.argsort(both["t_us"], kind="stable")]], [fault(60.0)])
    assert [m["component_id"] for m in live["monitors"]] == [OURS, THEIRS]
    assert [(line["component_id"], line["agreement"]) for line in live["faults"]] == [
        (OURS, "both"),
        (THEIRS, "replay only"),
    ]


def said(name: str, value: float, component: int, text: str = "", system: int = 1) -> np.ndarray:
    out = np.zeros(1, WORD)
    out[0] = (S, system, component, name.encode(), value, text.encode())
    return out


@pytest.mark.parametrize(
    "others",
    [
        [said("FLT_AIR", 1.0, FOREIGN)],  # the name by chance
        [said("FLT_AIR", 3.7, FOREIGN), said("MON_AIR", -1.0, FOREIGN)],  # no masks
        [said("FLT_AIR", 1.0, FOREIGN), said("MON_AIR", 0.5, FOREIGN)],
        [said("FLT_AIR", np.nan, OURS), said("FLT_AIR", 2.0**25, OURS)],
        [said("FLT_AIR", 8.0, OURS)],  # a bit that is no sensor's
        [said("R_CAS", 20.0, OURS), said("VIBE_X", 1.0, FOREIGN)],
        [said("", 0.0, FOREIGN, "airspeed0 FAULTY: 3.1 m/s low"), said("", 0.0, OURS, "hello")],
        [said("FLT_AIR", 1.0, OURS, system=2), said("MON_AIR", 1.0, OURS, system=2)],
        [said("FLT_AIR", 1.0, 256 + OURS), said("FLT_AIR", 1.0, OURS, system=-1)],  # damaged
        [],
    ],
)
def test_others_are_never_taken_for_a_monitor(others) -> None:
    assert read_back(others, [fault(1.0)]) is None


def test_where_no_mask_was_logged_the_texts_tell() -> None:
    heard = words(publish([*HEALTHY, BROKEN, MENDED]))
    live = read_back([heard[heard["name"] == b""]], [fault(60.0, 90.0)])
    (line,) = live["faults"]
    assert (line["agreement"], line["said"]) == ("both", "airspeed0 FAULTY: 3.1 m/s low since 2 s")
    assert line["live_cleared_s"] == pytest.approx(90.3, abs=3.0)
    quiet = words(publish(HEALTHY))
    assert read_back([quiet[quiet["name"] == b""]])["faults"] == []


def test_where_no_sender_was_logged_our_names_are_ours() -> None:
    heard = words(publish([*HEALTHY, BROKEN]), component=0, system=0)
    live = read_back([heard], [fault(60.0)], system=7)
    assert [m["component_id"] for m in live["monitors"]] == [OURS]
    assert live["faults"][0]["agreement"] == "both"


def test_an_engine_that_stopped_is_read_back() -> None:
    stopped = verdict(60.0, "engine0", State.STOPPED, onset_t_us=58 * S)
    started = [verdict(1.0, "engine0", State.OK), verdict(80.0, "engine0", State.OK)]
    event = {"what": "engine0", "state": "stopped", "detected_s": 60.0, "ended_s": 80.0}
    live = read_back([words(publish([started[0], stopped, started[1]]))], [event])
    (line,) = live["faults"]
    assert (line["sensor"], line["state"], line["agreement"]) == ("engine0", "stopped", "both")
    assert line["live_cleared_s"] == pytest.approx(80.3, abs=0.1)
    assert line["said"] == "engine0 STOPPED: no power since 2 s"


NAMES = [FAULT + mask for mask in SENSORS] + [MONITORED + mask for mask in SENSORS] + [ENGINES, ""]
WORDS = st.tuples(
    st.integers(-S, 400 * S),
    st.integers(0, 3),
    st.integers(0, 255),
    st.sampled_from([name.encode() for name in NAMES]),
    st.floats(width=32) | st.integers(0, 7).map(float),
    st.sampled_from(
        [b"airspeed0 FAULTY: x", b"ok: imu0", b"FAULTY: imu0.acc_x .gyro_z +2", b"\xff"]
    ),
)


@given(st.lists(st.lists(WORDS, max_size=30), max_size=4))
def test_no_words_are_an_exception(parts) -> None:
    live = read_back([np.array(part, WORD) for part in parts], [fault(60.0)], system=0)
    assert live is None or len(live["monitors"]) <= MONITORS


def test_no_more_monitors_are_told_apart_than_there_is_room_for() -> None:
    many = [said(name, 1.0, k) for k in range(1, 100) for name in ("FLT_AIR", "MON_AIR")]
    assert len(read_back(many)["monitors"]) == MONITORS


def test_flags_that_flicker_for_hours_fill_no_memory() -> None:
    heard = np.zeros(40_000, WORD)
    heard["t_us"], heard["component"] = np.arange(len(heard)) * S // 2, OURS
    heard["name"], heard["value"] = b"FLT_AIR", np.arange(len(heard)) // 20 % 2
    heard["name"][1::2], heard["value"][1::2] = b"MON_AIR", 1.0
    live = read_back([heard])
    assert 0 < len(live["faults"]) <= 2000
