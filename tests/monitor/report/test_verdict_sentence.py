"""The sentence on top of a report says what was judged, and no more."""

from __future__ import annotations

from typing import Any

import pytest

from links.vocabulary import Kind, Reason, State
from monitor.report.flight import Flight
from monitor.report.tables import MemoryTables
from monitor.report.verdict_sentence import Top, top, what_it_did
from monitor.settings import Settings
from monitor.verdict import Verdict
from tests.monitor.report.summaries import fault, span, summary, watched


def head(*verdicts: Verdict, **changed: Any) -> Top:
    return top(Flight(summary(**changed), Settings(), verdicts, MemoryTables({})))


def event(**changed: Any) -> dict[str, Any]:
    return {
        "what": "engine0",
        "state": "stopped",
        "onset_s": 140.0,
        "detected_s": 145.0,
        "ended_s": None,
        "evidence": "engine0 gives no power",
    } | changed


def said(t_s: float, sensor: str, state: State, reason: Reason | None = None) -> Verdict:
    return Verdict(int(1e6 * t_s), sensor, state, reason)


def test_a_healthy_flight_is_said_of_what_was_judged() -> None:
    shown = head()
    assert (shown.state, shown.verdict) == (State.OK, "No fault was found in the 4 sensors judged.")
    assert list(shown.besides) == []
    assert shown.title == "flight.tlog: No fault was found in the 4 sensors judged."


def test_one_fault_is_named_with_its_time_and_what_it_did() -> None:
    one = fault("airspeed0", 123.4, 124.0, cleared_s=245.0, magnitude=-3.14, unit="m/s")
    shown = head(faults=[one])
    assert shown.state is State.FAULTY
    assert shown.verdict == "airspeed0 was faulty from 2:03 to 4:05: it read 3.14 m/s too low."
    assert list(shown.besides) == [
        "acc_x is high.",
        "No fault was found in the other 3 sensors judged.",
    ]


def test_a_fault_that_was_not_cleared_lasts_to_the_end_of_the_log() -> None:
    shown = head(faults=[fault("imu0.gyro_z", 3700.0, 3701.0, magnitude=0.0349066, unit="rad/s")])
    assert shown.verdict == (
        "imu0.gyro_z was faulty from 1:01:40 to the end of the log: it read 2 deg/s too high."
    )


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        (Kind.BIAS, "read 1.5 m/s² too high"),
        (Kind.SCALE, "read 1.5 m/s² too high"),
        (Kind.UNKNOWN, "read 1.5 m/s² too high"),
        (Kind.STUCK, "always read the same"),
        (Kind.DROPOUT, "was dead"),
        (Kind.NOISE, "was noisy"),
        (Kind.OSCILLATION, "oscillated"),
        (Kind.RUNAWAY, "ran away"),
        (Kind.DRIFT, "drifted"),
    ],
)
def test_every_kind_has_its_words(kind: Kind, words: str) -> None:
    assert what_it_did(fault("imu0.acc_x", 1.0, 2.0, kind=str(kind))) == words


def test_a_fault_of_unknown_size_claims_none() -> None:
    unknown = fault("imu0.acc_x", 1.0, 2.0, kind="unknown", magnitude=None)
    assert what_it_did(unknown) == "did not agree with the others"


def test_several_faults_are_counted_and_the_first_ones_named() -> None:
    some = [fault(f"imu{k}.acc_x", 60.0 * k, 60.0 * k + 1) for k in range(1, 7)]
    verdict = head(faults=some).verdict
    assert verdict.startswith("6 faults: imu1.acc_x from 1:00 to the end of the log, ")
    assert verdict.endswith("imu4.acc_x from 4:00 to the end of the log and 2 more.")
    again = [fault("airspeed0", t, t + 1, cleared_s=t + 9) for t in (60.0, 120.0)]
    assert head(faults=again).verdict == (
        "airspeed0 was faulty 2 times, from 1:00 to 1:09 and from 2:00 to 2:09."
    )


def test_faults_that_were_too_many_to_list_are_counted() -> None:
    left_out = {"verdicts": 0, "faults": 1995, "events": 0, "spans": 0}
    shown = head(faults=[fault("gps0", t, t + 1) for t in range(5)], left_out=left_out)
    assert "2000 times" in shown.verdict
    assert shown.verdict.endswith("and 1,996 more.")
    assert "Too many to list: 1,995 faults more." in shown.besides


def test_an_engine_that_stopped_is_no_fault_of_a_sensor() -> None:
    shown = head(events=[event()])
    assert shown.state is State.STOPPED
    assert shown.verdict == (
        "engine0 stopped from 2:20 to the end of the log; no sensor was at fault."
    )
    assert shown.besides[0] == "engine0 gives no power."
    both = head(faults=[fault("airspeed0", 60.0, 61.0)], events=[event()])
    assert both.state is State.FAULTY
    assert both.verdict.endswith("; engine0 stopped from 2:20 to the end of the log.")
    assert "no sensor was at fault" not in both.verdict


def test_a_log_in_which_nothing_could_be_judged_is_not_called_healthy() -> None:
    ground = [watched("airspeed0", 0.0, span(0.0, 300.0, "on ground"))]
    shown = head(monitored=ground)
    assert shown.state is State.UNMONITORED
    assert shown.verdict == "No sensor could be judged (on ground)."
    assert head(monitored=[]).verdict == "No sensor could be judged."


def test_doubts_are_not_hidden_behind_no_fault() -> None:
    doubted = (
        said(50.0, "airspeed0", State.OK),
        said(100.0, "airspeed0", State.SUSPECT),
        said(112.0, "airspeed0", State.OK),
    )
    shown = head(*doubted)
    assert shown.state is State.SUSPECT
    assert shown.verdict == "No fault was named, but airspeed0 was suspect for 0:12."
    torn = said(100.0, "airspeed1", State.UNMONITORED, Reason.SENSORS_DISAGREE)
    assert "airspeed1 disagreed with its like for 3:20" in head(torn).verdict


def test_what_could_not_be_judged_is_said_by_reason_and_absent_sensors_are_not() -> None:
    airframe = span(30.0, 300.0, "no airframe coefficients")
    wings = [watched(f"wing_left.{what}", 0.0, airframe) for what in ("lift", "drag")]
    missing = watched("imu2", 0.0, span(0.0, 300.0, "absent"))
    pitot = watched("airspeed0", 200.0)
    besides = head(monitored=[pitot, *wings, missing]).besides
    assert list(besides) == ["Could not be judged: 2 wing channels, no airframe coefficients."]


def test_silence_gaps_restarts_and_learnt_thresholds_are_said() -> None:
    quiet = (said(60.0, "gps0", State.STALE), said(75.0, "gps0", State.OK))
    shown = head(
        *quiet,
        log={"gaps": [{"at_s": 10.0, "seconds": 65.0}], "boots_s": [80.0]},
        learnt={"note": "this flight taught the thresholds"},
    )
    assert list(shown.besides) == [
        "Sent nothing for a while: gps0 for 0:15.",
        "The recording has a gap, 1 min 05 s in all.",
        "The vehicle booted anew at 1:20.",
        "This flight taught the thresholds.",
    ]


def test_the_facts_of_the_flight() -> None:
    facts = {f.term: (f.value, f.small) for f in head(log={"start_unix_us": 1e15}).facts}
    assert facts["Duration"] == ("5:00", "judged in flight for 4:28")
    assert facts["Start"] == ("2001-09-09", "01:46:40 UTC")
    assert facts["Vehicle"] == ("fixed wing", "ArduPilot, system 1")
    assert facts["Log"] == ("tlog, 1 MB", "20,000 messages")
    assert {f.term: f.value for f in head().facts}["Start"] == "not known"
