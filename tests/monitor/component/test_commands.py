import pytest

from links.mavlink import Vehicle
from links.mavlink.dialect import load_dialect
from links.mavlink.heard import Heard
from monitor.component.about import CAPABILITY, about
from monitor.component.asking import MavCmd, Result
from monitor.component.commands import Commands
from monitor.component.identity import Identity
from monitor.publish import Message
from monitor.settings.component import ComponentSettings

DIALECT = load_dialect("ardupilotmega")
S = 1_000_000


def number(name: str) -> int:
    return DIALECT.by_name[name].id


class Outputs:
    """Who publishes: a heartbeat and named values."""

    def __init__(self) -> None:
        self.us = {"NAMED_VALUE_FLOAT": 200_000, "HEARTBEAT": 1_000_000}
        self.calls: list[tuple[str, int]] = []

    def interval_us(self, name):
        return self.us.get(name, 0)

    def set_interval(self, name, interval_us):
        self.calls.append((name, interval_us))
        return name == "NAMED_VALUE_FLOAT"

    def newest(self, name):
        return [Message(name, {"value": k}) for k in range(2)] if name in self.us else []


class Service:
    def __init__(self, **settings: object) -> None:
        own = ComponentSettings(listen_s=0, **settings)
        identity = Identity(own, 191, lambda: Vehicle(1, 3, 1))
        identity.due(0)
        self.outputs = Outputs()
        self.commands = Commands(
            own,
            identity,
            self.outputs,
            lambda n: DIALECT.by_id[n].name if n in DIALECT.by_id else None,
            about(lambda: CAPABILITY["PARAM_ENCODE_C_CAST"]),
        )

    def ask(self, command, *params, target=(1, 191), now_us=0, link=0, confirmation=0, **fields):
        values = {f"param{k}": 0.0 for k in range(1, 8)}
        values |= {f"param{k}": float(v) for k, v in enumerate(params, start=1)}
        values |= {"command": command, "target_system": target[0], "target_component": target[1]}
        heard = Heard(
            "COMMAND_LONG", 255, 190, link, values | {"confirmation": confirmation} | fields, 0
        )
        return self.commands.hear(heard, now_us)


def ack(message: Message) -> tuple[int, int]:
    assert message.name == "COMMAND_ACK"
    assert message.fields["target_system"] == 255
    assert message.fields["target_component"] == 190
    return message.fields["command"], message.fields["result"]


def test_a_message_of_ours_is_given_on_the_link_of_the_question():
    first, *rest = Service().ask(MavCmd.REQUEST_MESSAGE, number("NAMED_VALUE_FLOAT"), link=3)
    assert ack(first) == (512, Result.ACCEPTED)
    assert [m.name for m in rest] == ["NAMED_VALUE_FLOAT"] * 2
    assert {m.link for m in (first, *rest)} == {3}


@pytest.mark.parametrize("command", [MavCmd.REQUEST_MESSAGE, MavCmd.REQUEST_AUTOPILOT_CAPABILITIES])
def test_our_version_and_capabilities(command):
    first, version = Service().ask(command, number("AUTOPILOT_VERSION"))
    assert ack(first)[1] == Result.ACCEPTED
    wanted = CAPABILITY["MAVLINK2"] | CAPABILITY["PARAM_ENCODE_C_CAST"] | CAPABILITY["COMMAND_INT"]
    assert version.fields["capabilities"] == wanted
    assert "AUTOPILOT_VERSION" == version.name


@pytest.mark.parametrize("wanted", [number("GPS_RAW_INT"), 65000, -3, float("nan"), float("inf")])
def test_a_message_that_we_have_not_is_denied(wanted):
    (answer,) = Service().ask(MavCmd.REQUEST_MESSAGE, wanted)
    assert ack(answer) == (512, Result.DENIED)


def test_intervals_are_told_and_set():
    service = Service()
    answer, told = service.ask(MavCmd.GET_MESSAGE_INTERVAL, number("NAMED_VALUE_FLOAT"))
    assert ack(answer)[1] == Result.ACCEPTED
    assert told.fields == {"message_id": 251, "interval_us": 200_000}
    _, same = service.ask(MavCmd.REQUEST_MESSAGE, number("MESSAGE_INTERVAL"), 251)
    assert same.fields == told.fields
    _, none = service.ask(MavCmd.GET_MESSAGE_INTERVAL, number("ATTITUDE"))
    assert none.fields["interval_us"] == 0
    (answer,) = service.ask(MavCmd.SET_MESSAGE_INTERVAL, 251, 500_000)
    assert ack(answer)[1] == Result.ACCEPTED
    assert service.outputs.calls == [("NAMED_VALUE_FLOAT", 500_000)]
    (answer,) = service.ask(MavCmd.SET_MESSAGE_INTERVAL, 0, 500_000)
    assert ack(answer)[1] == Result.DENIED
    for strange in (float("nan"), -7, 1e12):
        (answer,) = service.ask(MavCmd.SET_MESSAGE_INTERVAL, 251, strange, now_us=S)
        assert ack(answer)[1] in (Result.DENIED, Result.ACCEPTED)
    assert all(-1 <= us < 1 << 31 for _, us in service.outputs.calls)


def test_a_reboot_is_refused_with_a_reason():
    answer, text = Service().ask(MavCmd.PREFLIGHT_REBOOT_SHUTDOWN, 1)
    assert ack(answer) == (246, Result.DENIED)
    assert text.name == "STATUSTEXT"
    assert "reboot" in text.fields["text"]
    assert len(text.fields["text"]) <= 50


@pytest.mark.parametrize("command", [400, 21, 31010, 65535])
def test_what_we_do_not_know_is_said_to_be_unsupported(command):
    (answer,) = Service().ask(command, 1, 2, 3)
    assert ack(answer) == (command, Result.UNSUPPORTED)


@pytest.mark.parametrize("target", [(1, 1), (2, 191), (255, 190), (1, 192)])
def test_what_is_for_others_is_passed_over(target):
    assert Service().ask(400, 1, target=target) == []


@pytest.mark.parametrize("target", [(1, 0), (0, 0)])
def test_a_command_to_all_is_answered_only_where_we_can_give_what_it_asks(target):
    service = Service()
    for command in (400, MavCmd.PREFLIGHT_REBOOT_SHUTDOWN, MavCmd.SET_MESSAGE_INTERVAL):
        assert service.ask(command, 251, 1e6, target=target) == []
    assert service.outputs.calls == []
    assert service.ask(MavCmd.REQUEST_MESSAGE, number("GPS_RAW_INT"), target=target) == []
    assert len(service.ask(MavCmd.REQUEST_MESSAGE, number("HEARTBEAT"), target=target)) == 3


def test_a_retransmission_is_answered_again_and_not_carried_out_again():
    service = Service()
    for confirmation in range(4):
        out = service.ask(
            MavCmd.SET_MESSAGE_INTERVAL,
            251,
            500_000,
            confirmation=confirmation,
            now_us=confirmation * S // 2,
        )
        assert [ack(m) for m in out] == [(511, Result.ACCEPTED)]
    assert len(service.outputs.calls) == 1


def test_a_copy_over_another_link_is_answered_there_and_not_carried_out_again():
    service = Service()
    one = service.ask(MavCmd.SET_MESSAGE_INTERVAL, 251, 500_000, link=0)
    two = service.ask(MavCmd.SET_MESSAGE_INTERVAL, 251, 500_000, link=1, now_us=20_000)
    assert [m.link for m in (*one, *two)] == [0, 1]
    assert len(service.outputs.calls) == 1


def test_the_same_command_later_is_a_new_one():
    service = Service()
    service.ask(MavCmd.SET_MESSAGE_INTERVAL, 251, 500_000)
    service.ask(MavCmd.SET_MESSAGE_INTERVAL, 251, 500_000, now_us=S)
    service.ask(MavCmd.SET_MESSAGE_INTERVAL, 251, 500_000, now_us=S + 1000, confirmation=0)
    assert len(service.outputs.calls) == 2
    service.ask(MavCmd.SET_MESSAGE_INTERVAL, 251, 100_000, now_us=S + 2000)
    assert len(service.outputs.calls) == 3  # other parameters: another command


def test_an_unset_parameter_does_not_make_a_retransmission_a_new_command():
    service = Service()
    nan = float("nan")
    for k in range(2):
        service.ask(MavCmd.SET_MESSAGE_INTERVAL, 251, 500_000, nan, nan, confirmation=k)
    assert len(service.outputs.calls) == 1


def test_command_int_is_a_command_too():
    service = Service()
    fields = {f"param{k}": 0.0 for k in range(1, 5)} | {"x": 0, "y": 0, "z": 0.0}
    fields |= {"command": 512, "target_system": 1, "target_component": 191}
    fields["param1"] = float(number("HEARTBEAT"))
    out = service.commands.hear(Heard("COMMAND_INT", 255, 190, 0, fields, 0), 0)
    assert ack(out[0]) == (512, Result.ACCEPTED)
    assert len(out) == 3


def test_a_flood_is_answered_at_its_rate_only():
    service = Service(answers_per_s=20)
    answers = sum(
        len(service.ask(400, k, now_us=k * 1000)) for k in range(10_000)
    )  # 1000 a second for 10 s
    assert 200 <= answers <= 225
    assert service.commands.dropped == 10_000 - answers


def test_nothing_is_answered_before_we_have_an_id():
    own = ComponentSettings(listen_s=5)
    identity = Identity(own, 191, lambda: Vehicle(1, 3, 1))
    identity.due(0)
    service = Service()
    service.commands._identity = identity
    assert service.ask(400) == []
