"""Changed keys with their meaning, thresholds in force, what was learnt."""

import pytest

from monitor.report.configuration_found import (
    changed_keys,
    described,
    learnt_from,
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
