"""Scoring of verdicts against known faults, ours and the autopilots'."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from monitor.announced import Said, announced
from monitor.commands.bench_against.judges import JUDGES, OURS, PX4
from monitor.commands.bench_against.score import Fault, Score, Truth, beaten, score
from monitor.commands.bench_against.tables import Flight, as_json, markdown

TRUTH = Truth(faults=[Fault(sensors=["imu0.acc_x"], on=100.0, off=150.0)], tolerated=["gps"])


@pytest.mark.parametrize(
    ("said", "delay", "false"),
    [
        ([], None, 0),
        ([Said("imu0.acc_x", 101.0)], 1.0, 0),
        ([Said("imu0", 103.0), Said("imu", 102.0)], 2.0, 0),
        ([Said("imu0.acc_y", 101.0)], None, 1),
        ([Said("imu1", 101.0)], None, 1),
        ([Said("imu0.acc_x", 99.0)], None, 1),
        ([Said("imu0.acc_x", 164.0)], 64.0, 0),
        ([Said("imu0.acc_x", 166.0), Said("gps0", 5.0)], None, 1),
    ],
)
def test_a_verdict_counts_on_its_sensor_while_the_fault_shows(
    said: list[Said], delay: float | None, false: int
) -> None:
    found = score(said, TRUTH)
    assert found.delays_s == [delay]
    assert len(found.false) == false


def test_announcements_become_verdicts() -> None:
    texts = [
        {"t_s": 10.0, "text": "Airspeed sensor 1 failure. Disabling"},
        {"t_s": 60.0, "text": "Airspeed sensor 1 now OK. Re-enabled"},
        {"t_s": 65.0, "text": "Airspeed sensor 1 failure. Disabling"},
        {"t_s": 70.0, "text": "EKF3 lane switch 1"},
        {"t_s": 90.0, "text": "EKF3 lane switch 0"},
        {"t_s": 95.0, "text": "EKF3 IMU0 is using GPS"},
    ]
    assert announced(texts) == [
        Said("airspeed0", 10.0, None),
        Said("imu0", 70.0, 90.0),
        Said("imu1", 90.0, None),
    ]


def test_where_another_is_earlier_or_says_less_it_is_told() -> None:
    scores = {j: Score([None], []) for j in JUDGES}
    scores[OURS] = Score([3.0], [Said("airspeed1", 5.0)])
    scores[PX4] = Score([2.0], [])
    lines = beaten(TRUTH, scores)
    assert f"imu0.acc_x: {PX4} 2.0 s, {OURS} 3.0 s" in lines
    assert len([line for line in lines if line.startswith("false verdicts")]) == len(JUDGES) - 1


def test_tables_of_a_flight_known_and_of_one_unknown() -> None:
    said = {j: [Said("imu0.acc_x", 101.0)] for j in JUDGES}
    known = Flight("a", said, TRUTH, {j: score(v, TRUTH) for j, v in said.items()})
    unknown = Flight("b", said, None, {})
    text = markdown([known, unknown])
    assert "| a | imu0.acc_x | 100 s | 1.0 s |" in text
    assert "| b | not known | imu0.acc_x 101 s |" in text
    assert text.rstrip().endswith("- nowhere")
    document = json.loads(json.dumps(as_json([known, unknown]), allow_nan=False))
    assert [f["delays_s"].get(OURS) for f in document["flights"]] == [[1.0], None]


def test_a_flight_from_the_command_line(shared_data: Path, tmp_path: Path) -> None:
    from monitor.commands.bench import app

    truth = shared_data / "sitl" / "expected.json"
    log = shared_data / "sitl" / "h5_pitot_autotest.tlog"
    arguments = ["against", str(log), "--truth", str(truth), "--out", str(tmp_path)]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    (flight,) = json.loads((tmp_path / "against.json").read_text())["flights"]
    assert flight["beaten"] == []
    assert flight["false"][OURS] == []
    assert all(flight["delays_s"][j][0] is not None for j in JUDGES)
    assert "airspeed0" in (tmp_path / "against.md").read_text()


@pytest.mark.parametrize("text", ["[]", "{", '{"a": {"faults": [{"on": 1}]}}'])
def test_a_truth_of_another_form_is_refused(tmp_path: Path, text: str) -> None:
    from monitor.commands.bench_against.command import _truths
    from monitor.commands.common import Refused

    file = tmp_path / "truth.json"
    file.write_text(text)
    with pytest.raises(Refused, match=r"truth\.json"):
        _truths(file)
