"""kill -9 in flight: the next process is right from its first message on."""

import pytest

from .restart import restart


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    return restart(0.5, tmp_path_factory.mktemp("restart"), then_s=12.0)


def test_a_fault_from_before_is_in_the_first_mask_and_not_said_again(found):
    assert found.before == ["airspeed0"]
    assert "taken up from" in found.notes
    assert "faulty: airspeed0" in found.notes
    assert found.first_masks["FLT_AIR"] == 1.0
    assert not [text for text in found.announced if text.startswith("airspeed0")]


def test_what_broke_while_it_was_dead_is_found_and_nothing_else(found):
    assert found.after == ["imu0.acc_x"]
    assert not [text for text in found.announced if "STALE" in text]
