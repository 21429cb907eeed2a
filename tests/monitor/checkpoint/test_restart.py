"""A monitor that was away for a while: right at once, nothing said twice, nothing missed."""

import pytest

from links.vocabulary import State
from monitor.checkpoint import Checkpointer
from monitor.settings import load
from sim_feeds.player import frames
from sim_feeds.scenario import parse
from tests.e2e.restart import KILLED_S, SCENARIO, circuit

from .conftest import SLICE_US, monitor

SINCE_S = 4.0
"""The checkpoint is this old when the process is killed: nearly the interval."""

AFTER_S = 22.0


def slices(*, healthy: bool) -> list[bytes]:
    text = SCENARIO.format(flight=circuit(150.0), breaks_s=70.0, unseen_s=KILLED_S + 0.2)
    if healthy:
        text = text[: text.index("[[fault]]")]
    out: dict[int, bytes] = {}
    first_us = None
    for t_us, frame in frames(parse(text)):
        first_us = t_us if first_us is None else first_us
        if t_us - first_us > (KILLED_S + 30.0 + AFTER_S) * 1e6:
            break
        out[(t_us - first_us) // SLICE_US] = out.get((t_us - first_us) // SLICE_US, b"") + frame
    return [out[k] for k in sorted(out)]


def fly(stages, data):
    """Verdicts, texts and, of each mask, what was sent first."""
    verdicts, texts, masks = [], [], {}
    for k, part in enumerate(data):
        result = stages.pipeline.feed(stages.decoder.feed(part))
        stages.publisher.note(result)
        verdicts += result.verdicts
        heard_us = stages.pipeline.now_us if stages.decoder.rows else None
        for message in stages.publisher.due(k * SLICE_US, heard_us, silent=False):
            if message.name == "STATUSTEXT":
                texts.append(message.fields["text"])
            elif message.name == "NAMED_VALUE_FLOAT":
                masks.setdefault(message.fields["name"], message.fields["value"])
    return verdicts, texts, masks


@pytest.fixture(scope="module")
def killed(tmp_path_factory):
    """Of a healthy flight and of one with faults: the data, the checkpoint, what was said."""
    out = {}
    for healthy in (True, False):
        data, stages = slices(healthy=healthy), monitor()
        folder = tmp_path_factory.mktemp("state")
        fly(stages, data[: round((KILLED_S - SINCE_S) * 1e6 / SLICE_US)])
        Checkpointer(folder, load(), *stages).close()
        out[healthy] = data, folder, dict(stages.publisher.states)
    return out


def away(killed, away_s, *, healthy=False, keeps=True):
    """What a monitor says that begins ``away_s`` after the other one was killed."""
    data, folder, _ = killed[healthy]
    stages = monitor()
    if keeps:
        Checkpointer(folder, load(), *stages).resume()
    begin, slices_after = (
        round((KILLED_S + away_s) * 1e6 / SLICE_US),
        round(AFTER_S * 1e6 / SLICE_US),
    )
    return *fly(stages, data[begin : begin + slices_after]), stages


def faulty(verdicts):
    return {v.sensor: v for v in verdicts if v.state is State.FAULTY}


@pytest.mark.parametrize("away_s", [0.5, 5.0, 30.0])
def test_nothing_is_wrong_after_it_was_away(killed, away_s):
    verdicts, texts, masks, _ = away(killed, away_s, healthy=True)
    assert not faulty(verdicts)
    assert State.STALE not in {v.state for v in verdicts}
    assert texts == []
    assert {masks["FLT_AIR"], masks["FLT_IMU0"]} == {0.0}


@pytest.mark.parametrize("away_s", [0.5, 5.0, 30.0])
def test_a_fault_from_before_stands_and_one_of_meanwhile_is_found(killed, away_s):
    verdicts, texts, masks, stages = away(killed, away_s)
    assert killed[False][2]["airspeed0"] is State.FAULTY
    assert masks["FLT_AIR"] == 1.0
    found = faulty(verdicts)
    assert set(found) == {"imu0.acc_x"}
    begun_us = stages.decoder.first_t_us + round((KILLED_S + away_s) * 1e6)
    assert found["imu0.acc_x"].t_us - begun_us < 2_000_000
    assert [text.partition(":")[0] for text in texts] == ["imu0.acc_x FAULTY"]
    assert stages.publisher.states["airspeed0"] is State.FAULTY


def test_without_a_checkpoint_neither_is_known(killed):
    """What the checkpoint is for: who begins in the middle takes what is broken for usual."""
    verdicts, _, masks, _ = away(killed, 5.0, keeps=False)
    assert masks["FLT_AIR"] == 0.0
    assert not faulty(verdicts)
