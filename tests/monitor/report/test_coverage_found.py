"""What was checked, what could not be, and what to do about it."""

from typing import Any

import pytest

from links.vocabulary import Reason, Rejection, State
from monitor.report.coverage_found import fine, flown_s, missing, ordinary, unjudged, unseen
from monitor.report.remedies import ORDINARY, REJECTED, remedy
from tests.monitor.report.summaries import fault, span, stream, summary, watched


def test_every_reason_and_every_rejection_is_explained() -> None:
    reasons = [str(r) for r in (*Reason, State.STALE, State.ABSENT)]
    assert [r for r in reasons if not remedy(r, "imu0.acc_x").meaning] == []
    assert set(REJECTED) == {str(r) for r in Rejection}
    silent = {r for r in reasons if not remedy(r, "airspeed0").action}
    assert silent == ORDINARY | {str(Reason.MANOEUVRE)}


def test_a_reason_means_what_the_sensor_needs() -> None:
    missing_of = {s: remedy("reference missing", s).action for s in ("airspeed0", "spool1")}
    assert "receiver" in missing_of["airspeed0"]
    assert "SERVO_OUTPUT_RAW" in missing_of["spool1"]
    assert "least_airspeed" in remedy(str(Reason.MANOEUVRE), "wing_left.lift").meaning


def test_a_faulty_sensor_is_not_among_the_fine() -> None:
    found = fine(summary(faults=[fault("imu0.acc_x", 100.0, 101.0)]))
    assert [f.sensors for f in found] == [("imu0.gyro_z",), ("airspeed0",), ("gps0",)]


def test_an_engine_that_stopped_is_not_among_the_fine() -> None:
    stopped = {"what": "engine0", "state": "stopped"}
    base = summary()
    flight = base | {"monitored": [*base["monitored"], watched("engine0", 200.0)]}
    assert ("engine0",) in [f.sensors for f in fine(flight)]
    assert ("engine0",) not in [f.sensors for f in fine(flight | {"events": [stopped]})]


def test_the_share_counts_the_time_in_the_air() -> None:
    found = {f.sensors[0]: f.share for f in fine(summary())}
    assert flown_s(summary()) == 270.0
    assert found["airspeed0"] == pytest.approx(240.0 / 270.0)
    assert found["imu0.acc_x"] == pytest.approx(268.0 / 270.0)
    assert found["gps0"] == 1.0  # judged on the ground too: no more than all of the flight


def test_a_reference_that_stopped_in_flight_was_not_there_all_the_time() -> None:
    gone = watched("gps0", 246.0, span(100.0, 154.0, "stale"))
    base = summary()
    flight = base | {"monitored": [m for m in base["monitored"] if m["sensor"] != "gps0"] + [gone]}
    (share,) = [f.share for f in fine(flight) if f.sensors == ("gps0",)]
    assert share == pytest.approx(1.0 - 54.0 / 270.0)


def test_without_a_flight_there_is_no_share() -> None:
    ground = [watched("gps0", 7.0), watched("imu0.acc_x", 0.0, span(0.0, 7.0, "on ground"))]
    (only,) = fine(summary(monitored=ground, log={"duration_s": 7.0}))
    assert only.share is None
    assert only.sensors == ("gps0",)


def test_what_could_not_be_judged_stands_together() -> None:
    away = span(100.0, 120.0, "reference not trusted"), span(150.0, 155.0, "reference not trusted")
    brief = span(200.0, 200.4, "reference missing")
    flight = summary(
        monitored=[
            watched("airspeed0", 200.0, *away, brief),
            watched("airspeed1", 200.0, *away),
            watched("imu2", 0.0, span(2.0, 300.0, "absent")),
            watched("spool1", 0.0, span(5.0, 300.0, "absent")),
        ]
    )
    found = [(u.sensors, u.reason, u.seconds) for u in unjudged(flight)]
    assert found == [
        (("airspeed0", "airspeed1"), "reference not trusted", 25.0),
        (("imu2", "spool1"), "absent", 298.0),
    ]
    assert ordinary(flight) == []


def test_what_never_left_the_ground_was_not_checked() -> None:
    ground = span(2.0, 300.0, "on ground")
    base = summary()
    flight = base | {"monitored": [watched("imu0.acc_x", 0.0, ground), watched("gps0", 300.0)]}
    assert [(u.sensors, u.reason) for u in unjudged(flight)] == [(("imu0.acc_x",), "on ground")]
    assert ordinary(flight) == []
    assert "on ground" not in [u.reason for u in unjudged(base)]


def test_ground_and_learning_stand_apart() -> None:
    assert [(u.reason, u.sensors) for u in ordinary(summary())] == [
        ("on ground", ("airspeed0", "imu0.acc_x", "imu0.gyro_z")),
        ("learning", ("imu0.acc_x", "imu0.gyro_z")),
        ("learning", ("airspeed0",)),
    ]


def _streams(*sensors: str) -> dict[str, Any]:
    return summary(streams=[stream(s) for s in sensors])


def test_streams_without_a_verdict_and_what_is_not_in_the_log() -> None:
    assert unseen(_streams("imu0", "airspeed0", "airspeed1", "nav", "servo")) == ["airspeed1"]
    assert missing(_streams("imu0")) == ["satellite velocity", "attitude", "airspeed sensor"]
    assert missing(summary()) == []
