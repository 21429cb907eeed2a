import random

import pytest

from links.mavlink import Vehicle
from links.mavlink.heard import Heard
from monitor.component.identity import Identity
from monitor.component.timesync import TimeSync
from monitor.settings.component import ComponentSettings

S = 1_000_000
AHEAD_NS = 123_456_789_000


class Net:
    """Us, and an autopilot on link 2 whose clock is ahead of ours."""

    def __init__(self, **settings: object) -> None:
        own = ComponentSettings(listen_s=0, **settings)
        self.identity = Identity(own, 191, lambda: Vehicle(1, 3, 1))
        self.identity.due(0)
        fields = {"autopilot": 3, "type": 1}
        self.identity.hear(Heard("HEARTBEAT", 1, 1, 2, fields, 0), 0)
        self.sync = TimeSync(own, self.identity)

    def heard(self, name, fields, system=1, component=1, link=2, host_us=0):
        heard = Heard(name, system, component, link, fields, host_us)
        return self.sync.hear(heard, host_us)

    def answer(self, request, there_us: int, back_us: int, ahead_ns: int = AHEAD_NS) -> None:
        sent_us = request.fields["ts1"] // 1000
        tc1 = (sent_us + there_us) * 1000 + ahead_ns
        self.heard(
            "TIMESYNC",
            {"tc1": tc1, "ts1": request.fields["ts1"]},
            host_us=sent_us + there_us + back_us,
        )


def test_the_offset_is_that_of_the_quickest_answer():
    net, draw = Net(), random.Random(1)
    for k in range(20):
        for request in net.sync.due(k * 5 * S + S):
            assert request.link == 2
            assert request.fields["tc1"] == 0
            queued_us = draw.randrange(50_000)
            net.answer(request, 2000 + queued_us, 2000)
    known = net.sync.offset
    assert known is not None
    assert known.answers == 20
    assert abs(known.offset_ns - AHEAD_NS) <= known.round_trip_ns // 2
    assert known.round_trip_ns < 25_000_000
    assert "round trip" in net.sync.facts[0]


@pytest.mark.parametrize("answered", [True, False])
def test_requests_come_at_their_period_after_the_first_few(answered):
    net = Net(timesync_s=5.0)
    times = []
    for k in range(600):
        for request in net.sync.due(k * S // 10):
            times.append(k / 10)
            if answered:
                net.answer(request, 1000, 1000)
    assert times[:6] == pytest.approx([0, 1, 2, 3, 4, 9])
    assert times[-1] - times[-2] == pytest.approx(5.0)


def test_none_go_out_when_switched_off():
    assert Net(timesync_s=0).sync.due(S) == []


def test_answers_to_others_and_made_up_ones_are_not_ours():
    net = Net()
    (request,) = net.sync.due(S)
    ours = request.fields["ts1"]
    for stamp, sender in ((ours + 1, (1, 1)), (ours, (1, 240)), (ours, (9, 1)), (0, (1, 1))):
        fields = {"tc1": 5_000_000_000, "ts1": stamp}
        assert net.heard("TIMESYNC", fields, *sender, host_us=S + 10) == []
    assert net.sync.offset is None
    net.answer(request, 1000, 1000)
    assert net.sync.offset is not None
    net.answer(request, 1000, 90_000)  # the same answer again
    assert net.sync.offset.answers == 1


def test_an_answer_is_never_answered():
    net = Net()
    assert net.heard("TIMESYNC", {"tc1": 7, "ts1": 5}) == []
    assert net.heard("TIMESYNC", {"tc1": -7, "ts1": 5}, 255, 190) == []


def test_our_own_question_come_back_is_not_answered():
    net = Net()
    (request,) = net.sync.due(S)
    assert net.heard("TIMESYNC", request.fields, 255, 190) == []


def test_an_old_answer_says_nothing():
    net = Net()
    (request,) = net.sync.due(S)
    net.answer(request, 1000, 3 * S)
    assert net.sync.offset is None


def test_a_clock_that_began_anew_is_followed_at_once():
    net = Net()
    for k in range(8):
        for request in net.sync.due(k * 10 * S + S):
            net.answer(request, 1000, 1000)
    for request in net.sync.due(200 * S):
        net.answer(request, 30_000, 30_000, ahead_ns=0)
    assert abs(net.sync.offset.offset_ns) < 1_000_000


def test_the_autopilot_and_ground_stations_are_answered_where_they_asked():
    net = Net()
    for system, component, link in ((1, 1, 2), (255, 190, 0)):
        (out,) = net.heard(
            "TIMESYNC", {"tc1": 0, "ts1": 77}, system, component, link, host_us=5 * S
        )
        assert out.fields == {"tc1": 5 * S * 1000, "ts1": 77}
        assert out.link == link


def test_a_companion_that_means_the_autopilot_is_left_to_it():
    assert Net().heard("TIMESYNC", {"tc1": 0, "ts1": 77}, 1, 240) == []


@pytest.mark.parametrize(
    ("target", "sender", "answers"),
    [
        ((1, 191), (1, 240), 1),
        ((1, 191), (255, 190), 1),
        ((1, 1), (255, 190), 0),
        ((1, 1), (1, 240), 0),
        ((0, 0), (255, 190), 1),
        ((1, 0), (255, 190), 1),
    ],
)
def test_a_question_with_a_target_is_answered_by_who_is_meant(target, sender, answers):
    payload = bytes(8) + b"\x4d" + bytes(7) + bytes(target)
    payload = payload.rstrip(b"\0")
    head = bytes([0xFD, len(payload), 0, 0, 9, *sender, 111, 0, 0])
    heard = Heard("TIMESYNC", *sender, 2, {"tc1": 0, "ts1": 77}, 0, False, head + payload + b"xx")
    assert len(Net().sync.hear(heard, 0)) == answers


def test_where_another_answers_the_autopilot_we_are_silent_for_as_long():
    net = Net()
    assert len(net.heard("TIMESYNC", {"tc1": 0, "ts1": 1}, host_us=S)) == 1
    net.heard("TIMESYNC", {"tc1": 99, "ts1": 1}, 1, 240, host_us=S + 500)
    assert net.heard("TIMESYNC", {"tc1": 0, "ts1": 2}, host_us=2 * S) == []
    assert len(net.heard("TIMESYNC", {"tc1": 0, "ts1": 3}, 255, 190, host_us=3 * S)) == 1
    assert len(net.heard("TIMESYNC", {"tc1": 0, "ts1": 4}, host_us=40 * S)) == 1


def test_a_ping_to_all_comes_back_to_its_sender():
    net = Net()
    ping = {"time_usec": 9, "seq": 4, "target_system": 0, "target_component": 0}
    (out,) = net.heard("PING", ping, 255, 190, 1)
    assert out.fields == ping | {"target_system": 255, "target_component": 190}
    assert out.link == 1
    # an answer, to us or to others, is never answered
    assert net.heard("PING", ping | {"target_system": 1, "target_component": 191}, 255, 190) == []


def test_floods_are_answered_at_their_rate_only():
    net = Net(answers_per_s=10)
    ping = {"time_usec": 9, "seq": 4, "target_system": 0, "target_component": 0}
    answers = sum(len(net.heard("PING", ping, 255, 190, host_us=k * 100)) for k in range(10_000))
    assert answers <= 21
