"""Who said it first, who never, and what only the others said."""

from monitor.report.autopilots_compared import JUDGES, OURS, compare, judged, sentences
from tests.monitor.report.summaries import fault, said, summary

LANE = {"t_s": 112.0, "severity": 2, "text": "EKF3 lane switch 1"}
TALK = {"t_s": 2.0, "severity": 6, "text": "EKF3 IMU0 initialised"}


def test_ours_first_then_the_others_in_their_order() -> None:
    flight = summary(
        faults=[fault("imu0.acc_x", 100.0, 100.8, cleared_s=170.0)],
        baselines={"ardupilot": [said("imu0", 146.0)], "autopilot_said": [TALK, LANE]},
    )
    (line,) = sentences(flight)
    assert line == (
        "imu0.acc_x, off since 1:40.0: mavsentry said so first, at 1:40.8; the autopilot itself "
        "11 s later; ArduPilot's checks 45 s later; PX4's checks never said it."
    )


def test_another_that_was_first_is_given_its_due() -> None:
    flight = summary(
        faults=[fault("airspeed0", 100.0, 118.0)],
        baselines={"px4": [said("airspeed0", 104.0)], "ardupilot": [said("airspeed0", 125.0)]},
    )
    (line,) = sentences(flight)
    assert "PX4's checks said so first, at 1:44.0; mavsentry 14 s later" in line
    assert "ArduPilot's checks 7.0 s later than mavsentry" in line
    assert "mavsentry said so first" not in line
    assert "the autopilot itself" not in line  # no text of it is known


def test_that_imus_differ_is_no_verdict_on_one_of_them() -> None:
    flight = summary(
        faults=[fault("imu0.acc_x", 100.0, 103.0)],
        baselines={"px4": [said("imu", 101.0, check="accelerometers differ")]},
    )
    (line,) = sentences(flight)
    assert "mavsentry said so first" in line
    assert "PX4's checks saw at 1:41.0 that the IMUs differ, not which is wrong" in line


def test_who_blamed_it_before_said_nothing_new() -> None:
    faults = [
        fault("imu0.acc_x", 100.0, 101.0, cleared_s=120.0),
        fault("imu0.acc_z", 200.0, 201.0),
    ]
    flight = summary(faults=faults, baselines={"ardupilot": [said("imu0", 110.0, 250.0)]})
    first, second = sentences(flight)
    assert "ArduPilot's checks 9.0 s later" in first
    assert "ArduPilot's checks had blamed imu0 since 1:50.0 and said nothing new" in second
    found = compare(judged(flight), faults)
    assert [f.before for f in found] == [{}, {"ArduPilot's checks": 110.0}]


def test_a_verdict_on_another_instrument_or_time_belongs_to_no_fault() -> None:
    flight = summary(
        faults=[fault("imu0.acc_x", 100.0, 101.0, cleared_s=120.0)],
        baselines={"ardupilot": [said("imu1", 105.0, 110.0), said("imu0", 150.0)]},
    )
    line, alone = sentences(flight)
    assert "ArduPilot's checks and PX4's checks never said it" in line
    assert alone == (
        "ArduPilot's checks also spoke of imu0 and imu1: disabled at 1:45.0 (2 times in all). "
        "mavsentry found no fault there at that time."
    )


def test_silence_is_said_of_those_who_could_speak() -> None:
    assert "announced nothing" not in sentences(summary())[0]
    spoken = summary(baselines={"autopilot_said": [TALK]})
    assert sentences(spoken)[0].endswith("and the autopilot announced nothing of the kind.")


def test_of_what_they_do_not_look_at_nothing_is_expected() -> None:
    (line,) = sentences(summary(faults=[fault("aoa1", 100.0, 102.0)]))
    assert line.endswith("mavsentry said so at 1:42.0; the autopilots' checks do not look at it.")


def test_where_nothing_was_judged_nobody_is_praised() -> None:
    flight = summary(monitored=[])
    assert sentences(flight)[0].startswith("No airspeed sensor and no IMU was judged")


def test_a_wild_flight_is_told_in_few_words() -> None:
    faults = [
        fault("imu0.acc_x", 2.0 * k, 2.0 * k + 0.5, cleared_s=2.0 * k + 1) for k in range(1500)
    ]
    theirs = [said("imu1", 2.0 * k, 2.0 * k + 1.0) for k in range(1500)]
    flight = summary(faults=faults, baselines={"px4": theirs})
    lines = sentences(flight)
    assert len(lines) == 14
    assert lines[12].startswith("1,488 more faults")
    assert len(judged(flight)) == 2000


def test_a_flight_without_a_fault_in_which_another_cried() -> None:
    flight = summary(baselines={"px4": [said("airspeed0", 50.0)], "lanes_lost_s": 30.2})
    lines = sentences(flight)
    assert lines[0] == "mavsentry found no faulty sensor in this flight."
    assert lines[1].startswith("PX4's checks also spoke of airspeed0: disabled at 0:50.0.")
    assert lines[2].startswith("For 30 s the lanes")


def test_the_table_holds_every_judge_in_order_of_time() -> None:
    event = {
        "what": "engine0",
        "state": "stopped",
        "onset_s": 4.0,
        "detected_s": 9.0,
        "ended_s": None,
        "evidence": "no power",
    }
    flight = summary(
        faults=[fault("imu0.acc_x", 100.0, 101.0)],
        events=[event],
        baselines={
            "ardupilot": [said("imu0", 101.0)],
            "px4": [said("imu", 99.0)],
            "autopilot_said": [TALK, LANE],
        },
    )
    found = judged(flight)
    assert [v.judge for v in found] == [OURS, JUDGES[2], OURS, JUDGES[1], JUDGES[3]]
    assert found[-1].what == "lane left"
    assert found[-1].evidence == "EKF3 lane switch 1"
    assert "mavsentry said at 0:09.0 that engine0 stopped" in " ".join(sentences(flight))
