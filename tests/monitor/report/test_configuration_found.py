"""Changed keys with their meaning, thresholds in force, live beside replay."""

import pytest

from monitor.report.configuration_found import (
    changed_keys,
    described,
    learnt_from,
    live_lines,
    thresholds,
)
from monitor.settings import Settings, changed, load

DIGEST = "0" * 64


@pytest.mark.parametrize(
    ("key", "unit", "says"),
    [
        ("imu.acc_size_m_s2", "m/s²", "accelerometer fault"),
        ("imu.gyro_noise_rad_s_sqrt_hz", "rad/s/√Hz", "Least noise density"),
        ("air.min_shift", "ln", "Least shift called a fault:"),
        ("imu.difference_sigma", "σ", "Two IMUs disagree"),
        ("streams.horizon_s", "s", "behind the newest"),
        ("air.horizon.margin_one", "", "accuses one"),
        ("engine.channels.spool0.noise_rpm", "rpm", "Standard deviation of its readings."),
        ("imu.no_such_key", "", ""),
    ],
)
def test_a_key_has_its_unit_and_meaning(key: str, unit: str, says: str) -> None:
    found = described(key)
    assert found[0] == unit
    assert says in found[1]
    assert bool(found[1]) == bool(says)


def test_changed_keys_stand_beside_the_profile() -> None:
    settings = load()
    own = settings.model_copy(
        update={"imu": settings.imu.model_copy(update={"acc_size_m_s2": 0.5})}
    )
    (key,) = changed_keys(own, changed(own))
    assert (key.name, key.value, key.usual) == ("imu.acc_size_m_s2", "0.5", "0.35")
    assert key.changed
    assert not key.learnt


def test_thresholds_of_what_is_in_the_log() -> None:
    names = [key.name for key in thresholds(load(), ["imu"])]
    assert "imu.difference_sigma" in names
    assert not [n for n in names if not n.startswith("imu.")]
    assert "air.margin_one" in [k.name for k in thresholds(load(), ["imu", "airspeed"])]
    assert all(key.meaning for key in thresholds(load(), ["imu", "airspeed", "aoa", "spool"]))


def test_learnt_values_say_from_what() -> None:
    assert learnt_from(load(), None) == []
    learnt = {
        "airframe": "ranger",
        "hours": 0.42,
        "keys": ["imu.difference_sigma"],
        "logs": [{"name": f"flight{i}.tlog", "sha256": DIGEST, "seconds": 250} for i in range(8)],
    }
    settings = Settings.model_validate({"learnt": learnt, "imu": {"difference_sigma": 10.1}})
    lines = learnt_from(settings, {"note": "thresholds were learnt from this very flight"})
    assert lines[0].startswith("1 value was learnt from 8 healthy flights of ranger, 0.42 h judged")
    assert lines[0].endswith("flight5.tlog and 2 more.")
    assert lines[1] == "Thresholds were learnt from this very flight."
    (key,) = changed_keys(settings, {"imu.difference_sigma": 10.1})
    assert key.learnt


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
