import pytest

from links.mavlink.heard import Heard
from monitor.component.asking import PATIENCE, TRIES, Asking, Command, Result

S = 1_000_000
COMMAND = Command(511, (27.0, 20_000.0), 1, 1, 4)


def ack(result: int, command: int = 511, sender=(1, 1), **target: int) -> Heard:
    return Heard("COMMAND_ACK", *sender, 4, {"command": command, "result": result} | target, 0)


def test_the_command_as_it_is_sent():
    (message,) = Asking().begin(COMMAND, 0)
    assert message.name == "COMMAND_LONG"
    assert message.link == 4
    assert message.fields == {
        "target_system": 1,
        "target_component": 1,
        "command": 511,
        "confirmation": 0,
        "param1": 27.0,
        "param2": 20_000.0,
    }


def test_never_two_at_a_time():
    asking = Asking()
    asking.begin(COMMAND, 0)
    with pytest.raises(ValueError, match="under way"):
        asking.begin(COMMAND, 1)


@pytest.mark.parametrize("result", [r for r in Result if r != Result.IN_PROGRESS])
def test_an_answer_ends_it(result):
    asking = Asking()
    asking.begin(COMMAND, 0)
    asking.hear(ack(result), (1, 191), 10)
    ended = asking.take()
    assert ended is not None
    assert (ended.command, ended.result) == (COMMAND, result)
    assert asking.take() is None
    assert not asking.busy


@pytest.mark.parametrize(
    "other",
    [
        ack(0, command=512),
        ack(0, sender=(1, 2)),
        ack(0, sender=(2, 1)),
        ack(0, target_system=255, target_component=190),
        ack(0, target_system=1, target_component=190),
    ],
)
def test_answers_to_others_do_not(other):
    asking = Asking()
    asking.begin(COMMAND, 0)
    asking.hear(other, (1, 191), 10)
    assert asking.take() is None
    assert asking.busy


def test_silence_ends_it_after_the_last_try():
    asking = Asking()
    sent = asking.begin(COMMAND, 0)
    for k in range(100):
        sent += asking.due(k * S // 10)
    assert [m.fields["confirmation"] for m in sent] == list(range(TRIES))
    ended = asking.take()
    assert ended is not None
    assert ended.result is None


def test_patience_has_an_end():
    asking = Asking()
    asking.begin(COMMAND, 0)
    for k in range(1000):
        asking.hear(ack(Result.IN_PROGRESS), (1, 191), k * S)
        asking.due(k * S)
        if (ended := asking.take()) is not None:
            assert ended.result is None
            assert k <= PATIENCE + 2 * TRIES
            break
    else:
        pytest.fail("it waited for ever")
