import pytest

from links.mavlink import Encoder, Vehicle
from links.mavlink.heard import Heard
from monitor.component import Component
from monitor.component.identity import CLASH_US, Identity
from monitor.publish import Message
from monitor.settings.component import ComponentSettings

S = 1_000_000
OURS = Encoder(1, 191)
BEAT = {"type": 18, "autopilot": 8, "system_status": 4, "mavlink_version": 3}


def identity(system: int = 1, **settings: object) -> Identity:
    return Identity(ComponentSettings(**settings), 191, lambda: Vehicle(system, 3, 1))


def beat(system: int, component: int, frame: bytes = b"", link: int = 0, **fields: int) -> Heard:
    return Heard("HEARTBEAT", system, component, link, BEAT | fields, 0, False, frame)


def frame(sequence: int = 0) -> bytes:
    sender = Encoder(1, 191)
    for _ in range(sequence):
        sender.encode("HEARTBEAT", **BEAT)
    return sender.encode("HEARTBEAT", **BEAT)


def texts(messages: list[Message]) -> list[str]:
    return [m.fields["text"] for m in messages if m.name == "STATUSTEXT"]


def test_nothing_is_sent_before_we_listened():
    component = Component(identity(listen_s=1.5))
    assert component.due(0) == []
    assert component.address is None
    component.due(S)
    assert component.address is None
    component.due(3 * S // 2)
    assert component.address == (1, 191)


def test_a_taken_id_is_left_to_who_has_it():
    component = Component(identity(other_ids=(192, 193)))
    component.due(0)
    component.hear(beat(1, 191, frame()), S)
    component.hear(beat(1, 192), S)
    component.due(2 * S)
    assert component.address == (1, 193)
    assert component.notes == ("component id 191 is taken by another: we are 193",)


def test_an_id_in_use_on_another_system_is_free_on_ours():
    component = Component(identity(other_ids=(192,)))
    component.due(0)
    component.hear(beat(7, 191), S)
    component.due(2 * S)
    assert component.address == (1, 191)


def test_when_all_ids_are_taken_the_first_stays_and_it_is_said():
    component = Component(identity(other_ids=(192,)))
    component.due(0)
    for k in (191, 192):
        component.hear(beat(1, k, frame()), S)
    component.due(2 * S)
    assert component.address == (1, 191)
    component.hear(beat(1, 191, frame(9)), 2 * S)
    component.hear(beat(1, 191, frame(10), link=2), 3 * S)
    said = component.due(3 * S)
    assert texts(said) == ["MAVSENTRY: another sender has our id 191"]
    (note,) = component.notes
    assert "component 191 of system 1, on link 2" in note
    component.hear(beat(1, 191, frame(11)), 4 * S)
    assert component.due(4 * S) == []  # said once
    component.due(4 * S + CLASH_US)
    assert component.notes == ()


def test_our_own_echo_is_nobody_else():
    component = Component(identity(listen_s=0))
    component.due(0)
    for k in range(50):
        data = OURS.encode("HEARTBEAT", **BEAT)
        component.sent(data)
        assert component.hear(beat(1, 191, data, link=1), k * S) == []
        assert component.hear(beat(1, 191, data, link=2), k * S) == []  # and by another way
    assert component.notes == ()


def test_the_echo_of_a_signed_frame_is_known_without_its_signature():
    component = Component(identity(listen_s=0))
    component.due(0)
    data = frame()
    component.sent(data[:2] + b"\x01" + data[3:] + bytes(13))
    for _ in range(3):
        component.hear(beat(1, 191, data), S)
    component.due(S)
    assert component.notes == ()


def test_the_same_message_by_another_sender_is_told_from_an_echo():
    component = Component(identity(listen_s=0))
    component.due(0)
    component.sent(frame(5))
    component.hear(beat(1, 191, frame(6)), S)
    component.hear(beat(1, 191, frame(7)), 2 * S)
    component.due(2 * S)
    assert component.notes


def test_one_late_frame_is_no_clash():
    component = Component(identity(listen_s=0))
    component.due(0)
    component.hear(beat(1, 191, frame()), S)
    component.due(S)
    assert component.notes == ()


def test_what_we_remember_has_a_bound():
    who = identity(listen_s=0)
    for k in range(9000):
        who.sent(b"\xfd\x01\0\0" + k.to_bytes(7, "little") + b"\0\0")
        who.hear(beat(1 + k % 255, 1 + k // 255), k)
    assert len(who._sent) <= 4096
    assert len(who._peers) <= 512


def test_the_system_is_the_vehicle_s_as_soon_as_there_is_one():
    vehicles: list[Vehicle | None] = [None]
    who = Identity(ComponentSettings(listen_s=0), 191, lambda: vehicles[0], system_id=1)
    who.due(0)
    assert who.address == (1, 191)
    vehicles[0] = Vehicle(7, 3, 1)
    who.due(S)
    assert who.address == (7, 191)


@pytest.mark.parametrize(
    ("target", "meant"),
    [((1, 191), True), ((0, 0), True), ((1, 0), True), ((1, 1), False), ((2, 191), False)],
)
def test_who_is_addressed(target, meant):
    assert identity().addressed(*target) is meant


class Ears:
    """A service that remembers."""

    wants = frozenset({"COMMAND_LONG", "PARAM_SET", "PARAM_VALUE"})
    notes = ()

    def __init__(self) -> None:
        self.heard: list[str] = []

    def hear(self, heard, now_us):
        self.heard.append(heard.name)
        return []

    def due(self, now_us):
        return []

    def close(self, now_us):
        return []


def told(name: str, system: int, component: int) -> Heard:
    return Heard(name, system, component, 0, {}, 0)


def test_another_vehicle_gives_no_orders_unless_it_may():
    for settings, expected in (({}, ["PARAM_VALUE"]), ({"obey_systems": (2,)}, 3)):
        ears = Ears()
        component = Component(identity(**settings), (ears,))
        component.hear(beat(2, 1, autopilot=12), 0)
        for name in ("COMMAND_LONG", "PARAM_SET", "PARAM_VALUE"):
            component.hear(told(name, 2, 1), 0)
        assert ears.heard == expected or len(ears.heard) == expected


def test_ground_stations_and_the_vehicle_give_orders():
    ears = Ears()
    component = Component(identity(), (ears,))
    component.hear(beat(1, 1, autopilot=3), 0)
    component.hear(beat(255, 190, type=6), 0)
    component.hear(told("PARAM_SET", 255, 190), 0)
    component.hear(told("COMMAND_LONG", 1, 1), 0)
    assert len(ears.heard) == 2


def test_what_carries_our_ids_is_shown_to_no_service():
    ears = Ears()
    component = Component(identity(listen_s=0), (ears,))
    component.due(0)
    component.hear(told("PARAM_SET", 1, 191), 0)
    assert ears.heard == []


def test_all_autopilots_are_listed_and_one_is_watched():
    component = Component(identity(2))
    component.hear(beat(1, 1, autopilot=3, type=2), 0)
    assert component.notes == ()
    component.hear(
        beat(
            2,
            1,
            autopilot=12,
            type=1,
        ),
        0,
    )
    component.hear(beat(255, 190, type=6), 0)
    who = component.identity
    assert {k: (a.kind, a.vehicle_type) for k, a in who.autopilots.items()} == {
        1: (3, 2),
        2: (12, 1),
    }
    assert who.autopilot is not None
    assert who.autopilot.system == 2
    assert component.notes == ("vehicle 2 is watched; also heard: 1 (run --system-id chooses)",)


def test_the_autopilot_is_spoken_to_on_one_link_until_it_is_silent_there():
    who = identity()
    for k in range(10):
        who.hear(beat(1, 1, autopilot=3, link=k % 2), k * S // 2)
    assert who.autopilot is not None
    assert who.autopilot.link == 0
    for k in range(10):
        who.hear(beat(1, 1, autopilot=3, link=1), (10 + k) * S // 2)
    assert who.autopilot.link == 1


def test_another_component_that_calls_itself_an_autopilot_is_none():
    who = identity()
    who.hear(beat(1, 1, autopilot=3), 0)
    who.hear(beat(1, 154, autopilot=0), 0)
    assert who.autopilot is not None
    assert who.autopilot.component == 1


def test_a_crowd_of_vehicles_makes_a_short_note():
    component = Component(identity())
    for system in range(1, 256):
        component.hear(beat(system, 1, autopilot=3), 0)
    (note,) = component.notes
    assert "2, 3, 4, 5, 6, 7, 8, 9 and 246 more" in note
