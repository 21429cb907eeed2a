"""What a monitor said in flight stands beside what the analysis says."""

from monitor.report.live_found import live_lines


def _live(**changed: object) -> dict[str, object]:
    return {
        "component_id": 191,
        "sensor": "imu0.acc_x",
        "state": "faulty",
        "agreement": "both",
        "live_s": 45.9,
        "live_cleared_s": 71.2,
        "replay_s": 45.4,
        "replay_cleared_s": None,
        "delay_s": 0.5,
        "standing": False,
        "said": "imu0.acc_x FAULTY: 3.0 m/s^2 high since 1 s",
    } | changed


def test_live_stands_beside_replay() -> None:
    monitor = {
        "component_id": 191,
        "from_s": 6.0,
        "to_s": 101.0,
        "words": 400,
        "silent": [{"from_s": 20.0, "to_s": 34.0}],
    }
    other = monitor | {"component_id": 192, "silent": [], "words": 1}
    unheard = _live(
        agreement="not heard", live_s=None, live_cleared_s=None, delay_s=None, said=None
    )
    sentences, rows = live_lines(
        {
            "monitors": [monitor, other],
            "faults": [_live(), unheard, _live(standing=True, delay_s=None)],
        }
    )
    assert sentences == [
        "Component 191 was heard from 0:06 to 1:41 (400 words), silent 0:20 to 0:34.",
        "Component 192 was heard from 0:06 to 1:41 (1 word); it said of no fault.",
    ]
    assert rows[0][1:4] == ["0:45.9 to 1:11.2", "0:45.4 to the end", "0.5 s later"]
    assert rows[1][1:] == ["not said", "0:45.4 to the end", "nothing was heard then", "–"]
    assert rows[2][1].startswith("before 0:45.9")
    assert rows[2][3] == "stood already"
