"""What arrived, what was missing, what was refused."""

from monitor.report.streams_found import damage, recorded, rejections, stream_rows
from tests.monitor.report.summaries import stream, summary


def test_a_whole_log_has_no_damage_and_one_span() -> None:
    assert damage(summary()) == []
    assert recorded(summary()) == [(0.0, 300.0)]


def test_damage_is_told_in_sentences() -> None:
    gaps = [{"at_s": 10.0 * i, "seconds": float(i)} for i in range(1, 7)]
    lines = damage(
        summary(
            log={
                "bad_bytes": 1200,
                "gaps": gaps,
                "boots_s": [61.0],
                "notes": ["vehicle_imu was logged at 2 Hz", "the log ends early."],
            },
            left_out={"verdicts": 0, "faults": 3, "events": 0, "spans": 0},
        )
    )
    assert lines == [
        "Damaged: 1,200 bytes (0.12 %) belong to no message.",
        "6 gaps in the recording: 3.0 s from 0:30, 4.0 s from 0:40, 5.0 s from 0:50, 6.0 s from "
        "1:00 and 2 shorter ones.",
        "The vehicle started anew at 1:01.",
        "vehicle_imu was logged at 2 Hz.",
        "The log ends early.",
        "3 more faults are not listed.",
    ]


def test_recorded_spans_leave_the_gaps_out() -> None:
    gaps = [{"at_s": 100.0, "seconds": 50.0}, {"at_s": -0.01, "seconds": 0.02}]
    assert recorded(summary(log={"gaps": gaps})) == [(0.01, 100.0), (150.0, 300.0)]
    assert recorded(summary(log={"gaps": [{"at_s": 290.0, "seconds": 50.0}]})) == [(0.0, 290.0)]


def test_rejections_are_explained_the_most_frequent_first() -> None:
    rejected = {"servo": {"late": 13}, "frame": {"bad crc": 4000, "new reason": 13}}
    rows = rejections(summary(rejected=rejected))
    assert [row[:3] for row in rows] == [
        ["whole messages", "bad crc", "4,000"],
        ["whole messages", "new reason", "13"],
        ["servo (outputs)", "late", "13"],
    ]
    assert "check sum" in rows[0][3]
    assert rows[1][3] == ""


def test_streams_as_rows() -> None:
    flight = summary(streams=[stream("imu0", samples=12_680, rate_hz=39.9642, gaps=2)])
    assert stream_rows(flight) == [["imu0", "X", "12,680", "40.0", "2"]]
