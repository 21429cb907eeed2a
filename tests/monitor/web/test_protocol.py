"""The example messages keep the protocol's own rules: a page is written against them."""

import typing

import pytest

from monitor.web import protocol

from .checked import checked
from .example import messages


def test_every_message_of_the_example_is_of_its_type():
    read = [checked(message) for message in messages()]
    assert [m["kind"] for m in read[:4]] == ["hello", "history", "history", "frame"]
    assert [m.get("last") for m in read[:4]] == [None, False, True, None]


def test_frames_count_on_from_hello_without_a_gap():
    hello, first, second, *frames = messages()
    history = [*first["frames"], *second["frames"]]
    assert hello["number"] == history[-1]["number"]
    numbers = [frame["number"] for frame in (*history, *frames)]
    assert numbers == list(range(len(numbers)))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"altitute": 1.0}, "no key altitute"),
        ({"t_s": "1"}, "frame.t_s"),
        ({"t_s": True}, "frame.t_s"),
        ({"measured": {"airspeed0": [1.0]}}, "frame.measured.airspeed0"),
        ({"link": None}, "frame.link"),
        ({"t_s": float("nan")}, "not JSON compliant"),
    ],
)
def test_what_is_not_of_the_protocol_is_refused(change, said):
    frame = next(m for m in messages() if m["kind"] == "frame")
    with pytest.raises(ValueError, match=said):
        checked(frame | change)


def test_a_key_that_must_be_there_is_missed():
    frame = next(m for m in messages() if m["kind"] == "frame")
    with pytest.raises(ValueError, match="flying is missing"):
        checked({key: value for key, value in frame.items() if key != "flying"})


def test_every_public_type_is_exported():
    own = {
        name
        for name, value in vars(protocol).items()
        if typing.is_typeddict(value) and not name.startswith("_")
    }
    assert own <= set(protocol.__all__)
