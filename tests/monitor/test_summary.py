"""The summary says what the verdicts said, in the log's own seconds."""

import json
from dataclasses import replace

from links.vocabulary import Kind, Reason, State
from monitor import summary
from monitor.verdict import Verdict


def at(t_s: float, state: State, reason: Reason | None = None) -> Verdict:
    return Verdict(round(t_s * 1e6), "airspeed0", state, reason)


FAULT = Verdict(
    t_us=12_000_000,
    sensor="airspeed0",
    state=State.FAULTY,
    kind=Kind.SCALE,
    onset_t_us=11_500_000,
    magnitude=-3.0,
    unit="m/s",
)


def test_a_fault_lasts_until_the_next_ok_whatever_is_between() -> None:
    verdicts = [at(5, State.OK), FAULT, at(14, State.STALE), FAULT, at(30, State.OK)]
    (fault,) = summary.faults(verdicts, first_us=2_000_000)
    assert (fault["onset_s"], fault["detected_s"], fault["cleared_s"]) == (9.5, 10.0, 28.0)
    assert (fault["kind"], fault["magnitude"], fault["unit"]) == ("scale", -3.0, "m/s")


def test_a_fault_is_detected_when_it_is_said_and_isolated_when_it_is_named() -> None:
    named = replace(FAULT, t_us=15_000_000, detected_t_us=12_000_000)
    for verdict, isolated_s in ((FAULT, 10.0), (named, 13.0)):
        (fault,) = summary.faults([verdict], first_us=2_000_000)
        assert (fault["detected_s"], fault["detected_t_us"]) == (10.0, 12_000_000)
        assert (fault["isolated_s"], fault["isolated_t_us"]) == (isolated_s, verdict.t_us)


def test_a_second_fault_of_the_same_sensor_is_a_second_entry() -> None:
    assert len(summary.faults([FAULT, at(20, State.OK), FAULT], first_us=0)) == 2


def test_what_is_not_known_is_null_in_json() -> None:
    (fault,) = summary.faults([Verdict(1, "airspeed0", State.FAULTY)], first_us=0)
    assert json.loads(json.dumps(fault, allow_nan=False))["magnitude"] is None


def test_monitored_seconds_and_spans_add_up() -> None:
    verdicts = [
        at(0, State.UNMONITORED, Reason.ON_GROUND),
        at(10, State.UNMONITORED, Reason.LEARNING),
        at(25, State.OK),
        at(60, State.STALE),
        at(70, State.OK),
    ]
    (entry,) = summary.monitored(verdicts, first_us=0, last_us=100_000_000)
    assert entry["seconds"] == 35 + 30
    assert [(s["from_s"], s["to_s"], s["reason"]) for s in entry["unmonitored"]] == [
        (0, 10, "on ground"),
        (10, 25, "learning"),
        (60, 70, "stale"),
    ]
