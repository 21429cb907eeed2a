"""A snapshot, taken up by fresh objects, equals never having stopped."""

import random

import pytest

from links.vocabulary import State
from monitor.checkpoint import file
from monitor.checkpoint.snapshot import load, take

from .conftest import monitor


def damaged(data):
    """The flight with what a bad link does to it: rows that are rejected, and counted."""
    return [*data[:300], *data[330:400], *data[300:320], *data[400:]]


def fly(stages, data, now_us=0):
    """Verdicts, the bytes of each table of estimates, and messages of some datagrams."""
    verdicts, estimates, messages = [], {}, []
    for part in data:
        now_us += 50_000
        result = stages.pipeline.feed(stages.decoder.feed(part))
        stages.publisher.note(result)
        verdicts += result.verdicts
        for name, rows in result.estimates.items():
            estimates[name] = estimates.get(name, b"") + rows.tobytes()
        messages += stages.publisher.due(now_us, stages.pipeline.now_us, silent=False)
    return [repr(v) for v in verdicts], estimates, messages


def restarted(stages, path):
    """Fresh objects that have taken up what the others had, through a file."""
    file.replace(path, take(*stages).pack())
    fresh = monitor()
    found = load(path, *fresh, 120.0)

    def take_up():
        found.take_up(*fresh, 120.0)

    fresh.decoder.on_vehicle = take_up
    return fresh


@pytest.mark.parametrize("flight", ["pair", "many"])
def test_going_on_from_a_snapshot_is_never_having_stopped(flight, request, tmp_path):
    data = damaged(request.getfixturevalue(flight))
    cuts = random.Random(flight).sample(range(20, len(data) - 1), 5)
    expected = fly(whole := monitor(), data)
    assert {s for s, v in whole.pipeline.states().items() if v.state is State.FAULTY} == {
        "imu0.acc_x",
        "airspeed0",
    }
    stages = monitor()
    verdicts, estimates = [], {}
    for begin, end in zip([0, *sorted(cuts)], [*sorted(cuts), len(data)], strict=True):
        if begin:
            stages = restarted(stages, tmp_path / "checkpoint")
        more, rows, _ = fly(stages, data[begin:end])
        verdicts += more
        for name, table in rows.items():
            estimates[name] = estimates.get(name, b"") + table
    assert sum(whole.pipeline.rejected.values()) > 100
    assert verdicts == expected[0]
    assert estimates == expected[1]
    assert stages.pipeline.rejected == whole.pipeline.rejected
