import pytest
from pydantic import ValidationError

from monitor.settings.component import ComponentSettings


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"stream_hz": {"imu9": 50}}, "imu9 is no stream that is asked for"),
        ({"stream_hz": {"imu0": -1}}, "greater than or equal to 0"),
        ({"other_ids": [192, 256]}, "256 is no MAVLink id"),
        ({"obey_systems": [0]}, "0 is no MAVLink id"),
        ({"answers_per_s": 0}, "greater than 0"),
    ],
)
def test_what_cannot_be_meant_is_refused_in_words(values, words):
    with pytest.raises(ValidationError, match=words):
        ComponentSettings(**values)


def test_by_default_the_id_stays_streams_are_asked_for_and_nobody_else_s_autopilot_is_obeyed():
    settings = ComponentSettings()
    assert settings.other_ids == settings.obey_systems == ()
    assert settings.request_streams
    assert settings.stream_hz == {}
