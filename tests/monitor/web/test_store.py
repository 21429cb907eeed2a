"""What the web process remembers: enough for a viewer who comes late, never more than its bound."""

import json

from monitor.web.store import FRAMES_AT_ONCE, LISTED, STANDINGS, Store

from .checked import checked
from .example import FAULTY_S, all_frames, hello


def fed(frames=10_000, size=10_000):
    store = Store(size)
    store.begin(json.dumps(hello([])).encode())
    for frame in list(all_frames())[:frames]:
        store.add(json.dumps(frame).encode())
    return store


def test_hello_says_what_stands_now():
    store = fed()
    said = checked(store.hello())
    assert said == checked(json.dumps(hello(list(all_frames()))))


def test_history_is_every_frame_in_messages_of_bounded_size():
    store = fed()
    messages = [checked(message) for message in store.history()]
    assert [m["last"] for m in messages] == [False] * (len(messages) - 1) + [True]
    assert max(len(m["frames"]) for m in messages) == FRAMES_AT_ONCE
    assert [f for m in messages for f in m["frames"]] == json.loads(json.dumps(list(all_frames())))


def test_history_before_any_frame_is_one_empty_message():
    assert [checked(m) for m in fed(0).history()] == [
        {"kind": "history", "last": True, "frames": []}
    ]


def test_history_does_not_change_while_it_is_sent():
    store = fed(250)
    history = store.history()
    next(history)
    store.add(json.dumps(list(all_frames())[250]).encode())
    rest = [checked(message) for message in history]
    assert rest[-1]["frames"][-1]["number"] == 249


def test_frames_are_forgotten_and_states_that_stand_are_not():
    store = fed(size=50)
    (message,) = store.history()
    frames = checked(message)["frames"]
    assert len(frames) == 50
    timeline = checked(store.hello())["timeline"]
    (standing,) = timeline["airspeed0"]  # since before the history
    assert (standing["state"], standing["t_s"]) == ("faulty", FAULTY_S)
    assert standing["t_s"] < frames[0]["t_s"]


def test_states_and_faults_without_end_stay_bounded():
    store = fed(0)
    frame = next(all_frames())
    fault = {"sensor": "airspeed0", "number": 0}
    for k in range(2000):
        change = {"airspeed0": [{"t_s": float(k), "state": "ok"}]}
        store.add(
            json.dumps(frame | {"changes": change, "faults": [fault | {"number": k}]}).encode()
        )
    said = json.loads(store.hello())
    assert len(said["timeline"]["airspeed0"]) == STANDINGS
    assert [f["number"] for f in said["faults"]] == list(range(2000 - LISTED, 2000))
    assert store.found["airspeed0"] == 2000
