from itertools import pairwise

import pytest

from monitor.announce import TEXT_MAX
from monitor.component.asking import MavCmd, Result
from monitor.component.intervals import Intervals
from monitor.needs import NEEDS
from monitor.publish import Message
from monitor.settings.component import ComponentSettings
from tests.monitor.component.autopilot import (
    ARDUPILOT,
    PX4,
    Autopilot,
    World,
    autopilot,
    named,
    number,
)


def asking(world: World, **sources: str) -> Intervals:
    pilot = world.pilot
    return Intervals(
        world.settings,
        world.identity,
        lambda name: number(name),
        pilot.streams,
        lambda: pilot.boots,
        lambda: sources,
    )


def said(messages: list[Message]) -> list[tuple[str, str, float, int]]:
    """Commands as (get or set, message, interval, confirmation)."""
    out = []
    for m in messages:
        if m.name == "COMMAND_LONG":
            f = m.fields
            word = "get" if f["command"] == MavCmd.GET_MESSAGE_INTERVAL else "set"
            out.append((word, named(f["param1"]), f.get("param2", 0.0), f["confirmation"]))
    return out


def texts(messages: list[Message]) -> list[str]:
    return [m.fields["text"] for m in messages if m.name == "STATUSTEXT"]


@pytest.mark.parametrize("kind", [ARDUPILOT, PX4])
def test_a_vehicle_that_lacks_nothing_is_asked_for_nothing(kind):
    world = World(autopilot(kind))
    service = asking(world)
    # imu1, pressure 2, spool0 ... do not come; whether they are fitted has to be asked once
    sent = said(world.run(service, 60))
    assert not {name for _, name, *_ in sent} & {
        "RAW_IMU", "SCALED_IMU", "ATTITUDE", "ATTITUDE_QUATERNION", "GPS_RAW_INT",
    }  # fmt: skip
    assert service.notes == ()


def test_the_message_that_a_stream_comes_from_is_asked_for():
    world = World(autopilot(ARDUPILOT, {"RAW_IMU": 4.0, "ATTITUDE": 3.0}))
    used = {"imu0": "HIGHRES_IMU", "attitude": "ATTITUDE_QUATERNION", "gps0": "NO_SUCH"}
    sent = said(world.run(asking(world, **used), 30))
    asked = {name for word, name, *_ in sent if word == "set"}
    assert asked >= {"HIGHRES_IMU", "ATTITUDE_QUATERNION"}
    assert not asked & {"RAW_IMU", "ATTITUDE", "NO_SUCH"}


@pytest.mark.parametrize(("kind", "message"), [(ARDUPILOT, "RAW_IMU"), (PX4, "SCALED_IMU")])
def test_a_slow_stream_is_asked_for_verified_and_put_back(kind, message):
    world = World(autopilot(kind, {message: 4.0}))
    service = asking(world)
    sent = said(world.run(service, 30))
    assert sent[:2] == [("get", message, 0.0, 0), ("set", message, 20_000.0, 0)]
    assert world.pilot.hz[message] == 50.0
    assert service.notes == ()
    assert any(f"{message} was asked for at 50 Hz (came at 4): comes at 50" in f
               for f in service.facts)  # fmt: skip
    for m in service.close(world.now_us):
        world.pilot.take(m, world.now_us)
    assert world.pilot.hz[message] == 4.0


@pytest.mark.parametrize("kind", [ARDUPILOT, PX4])
def test_a_stream_that_was_not_sent_is_stopped_again(kind):
    message = "ATTITUDE" if kind == ARDUPILOT else "ATTITUDE_QUATERNION"
    world = World(autopilot(kind, {message: 0.0}))
    service = asking(world)
    world.run(service, 30)
    assert world.pilot.hz[message] == 20.0
    for m in service.close(world.now_us):
        world.pilot.take(m, world.now_us)
    assert world.pilot.hz[message] == 0.0


def test_nothing_is_asked_before_a_rate_was_measured_or_an_id_taken():
    world = World(autopilot(slow={"RAW_IMU": 4.0}), ComponentSettings(listen_s=8))
    service = asking(world)
    assert world.run(service, 7.5) == []
    assert said(world.run(service, 5))


def test_one_command_is_under_way_at_a_time():
    slow = {"RAW_IMU": 4.0, "ATTITUDE": 2.0, "GPS_RAW_INT": 0.5, "SCALED_PRESSURE": 1.0}
    world = World(autopilot(slow=slow))
    world.run(asking(world), 60)
    commands = [(t, m) for t, m in world.sent if m.name == "COMMAND_LONG"]
    times = [t for t, _ in commands]
    assert len(times) == len(set(times)) >= 8  # each turn at most one, the next after its answer
    assert all(world.pilot.hz[name] > hz for name, hz in slow.items())


def test_a_lost_command_is_sent_again_with_its_confirmation_counted_up():
    world = World(autopilot(slow={"RAW_IMU": 4.0}, deaf_to=2))
    sent = said(world.run(asking(world), 20))
    assert sent[:4] == [
        ("get", "RAW_IMU", 0.0, 0),
        ("get", "RAW_IMU", 0.0, 1),
        ("get", "RAW_IMU", 0.0, 2),
        ("set", "RAW_IMU", 20_000.0, 0),
    ]
    times = [t for t, m in world.sent if m.name == "COMMAND_LONG"]
    assert times[1] - times[0] == pytest.approx(1.0, abs=0.06)


def test_in_progress_is_waited_for():
    world = World(autopilot(slow={"RAW_IMU": 4.0}, busy=1))
    service = asking(world)
    sent = [s for s in said(world.run(service, 30)) if s[:2] == ("set", "RAW_IMU")]
    times = [t for t, m in world.sent if said([m])[:1] and said([m])[0][:2] == ("set", "RAW_IMU")]
    # asked again only after the longer time that IN_PROGRESS asks for
    assert [c for *_, c in sent] == [0, 1]
    assert times[1] - times[0] == pytest.approx(3.05, abs=0.1)
    assert world.pilot.hz["RAW_IMU"] == 50.0


def test_answers_without_a_target_count_and_those_to_others_do_not():
    world = World(autopilot(slow={"RAW_IMU": 4.0}, bare_acks=True))
    world.run(asking(world), 20)
    assert world.pilot.hz["RAW_IMU"] == 50.0

    class ToOthers(Autopilot):
        def ack(self, now_us, command, result):
            fields = {"target_system": 255, "target_component": 190}
            return self.says("COMMAND_ACK", now_us, command=command, result=int(result), **fields)

    pilot = ToOthers(hz=autopilot(slow={"RAW_IMU": 4.0}).hz, fitted=autopilot().fitted)
    world = World(pilot)
    service = asking(world)
    sent = said(world.run(service, 20))
    assert [c for *_, c in sent] == [0, 1, 2]
    assert "does not answer" in service.notes[0]


def test_an_autopilot_that_never_answers_is_left_in_peace_and_asked_again_a_minute_later():
    world = World(autopilot(slow={"RAW_IMU": 4.0}, silent=True))
    service = asking(world)
    assert len(said(world.run(service, 60))) == 3
    assert service.notes == (
        "imu0 comes at 4.0 Hz, 50 are wanted: IMU faults are found later "
        "(the autopilot does not answer commands)",
    )
    assert texts([m for _, m in world.sent]) == ["Streams slow: imu0"]
    world.pilot.silent = False
    world.run(service, 40)
    assert world.pilot.hz["RAW_IMU"] == 50.0
    assert service.notes == ()


def test_an_autopilot_that_stays_silent_is_asked_ever_more_rarely():
    world = World(autopilot(slow={"RAW_IMU": 4.0}, silent=True))
    world.run(asking(world), 900)
    first = [t for t, m in world.sent if m.name == "COMMAND_LONG" and not m.fields["confirmation"]]
    assert [round(b - a, -1) for a, b in pairwise(first)] == [60, 120, 240]
    assert len(first) == 4


@pytest.mark.parametrize("result", [Result.DENIED, Result.FAILED])
def test_what_the_autopilot_refuses_is_said(result):
    world = World(autopilot(slow={"RAW_IMU": 4.0}, refuses={"RAW_IMU": result}))
    service = asking(world)
    sent = said(world.run(service, 60))
    assert len([s for s in sent if s[:2] == ("set", "RAW_IMU")]) == 1
    assert service.notes == (
        "imu0 comes at 4.0 Hz, 50 are wanted: IMU faults are found later "
        "(the autopilot refuses RAW_IMU at 50 Hz)",
    )
    # nothing was changed, so nothing is put back
    assert not [m for m in service.close(world.now_us) if m.fields["param1"] == number("RAW_IMU")]


def test_a_note_stays_as_it_is_while_the_rate_changes_little():
    world = World(autopilot(slow={"RAW_IMU": 4.0}, refuses={"RAW_IMU": Result.DENIED}))
    service, notes = asking(world), set()
    for k in range(40):
        world.pilot.hz["RAW_IMU"] = 4.0 + 0.4 * (k % 2)
        world.run(service, 3)
        notes |= set(service.notes)
    assert len(notes) == 1
    world.pilot.hz["RAW_IMU"] = 1.0
    world.run(service, 9)
    assert "imu0 comes at 1.0 Hz" in service.notes[0]
    world.pilot.hz["RAW_IMU"] = 30.0
    world.run(service, 9)
    assert service.notes == ()


def test_a_rate_that_is_rejected_for_now_is_tried_lower():
    world = World(autopilot(slow={"RAW_IMU": 4.0}, fastest_hz=30))
    service = asking(world)
    world.run(service, 30)
    assert world.pilot.hz["RAW_IMU"] == 25.0
    assert service.notes == ()


def test_an_autopilot_that_accepts_and_does_nothing_is_found_out():
    world = World(autopilot(PX4, {"SCALED_IMU": 4.0}, limits={"SCALED_IMU": 4.0}))
    service = asking(world)
    world.run(service, 60)
    assert "the autopilot accepted SCALED_IMU at 50 Hz and does not send it so" in service.notes[0]
    sets = [s for s in said([m for _, m in world.sent]) if s[:2] == ("set", "SCALED_IMU")]
    assert len(sets) == 1
    assert [m.fields["param2"] for m in service.close(world.now_us)
            if m.fields["param1"] == number("SCALED_IMU")] == [250_000]  # fmt: skip


def test_after_a_reboot_of_the_autopilot_it_is_asked_again():
    world = World(autopilot(slow={"RAW_IMU": 4.0}))
    service = asking(world)
    world.run(service, 30)
    world.pilot.reboot()
    assert world.pilot.hz["RAW_IMU"] == 4.0
    world.run(service, 30)
    assert world.pilot.hz["RAW_IMU"] == 50.0
    assert service.notes == ()


def test_who_sets_a_stream_back_twice_may_keep_it():
    world = World(autopilot(slow={"RAW_IMU": 4.0}))
    service = asking(world)

    def rival(seconds: float) -> None:
        if round(seconds / 0.05) % 400 == 0:  # every 20 s
            world.pilot.hz["RAW_IMU"] = 4.0

    world.run(service, 200, rival)
    sets = [s for s in said([m for _, m in world.sent]) if s[:2] == ("set", "RAW_IMU")]
    assert len(sets) == 2
    assert "another sets RAW_IMU back: it is left alone" in service.notes[0]
    assert not [m for m in service.close(world.now_us) if m.fields["param1"] == number("RAW_IMU")]


def test_a_rate_that_somebody_raised_further_is_not_put_back():
    world = World(autopilot(slow={"RAW_IMU": 4.0}))
    service = asking(world)
    world.run(service, 30)
    world.pilot.hz["RAW_IMU"] = 200.0
    world.run(service, 10)
    assert not [m for m in service.close(world.now_us) if m.fields["param1"] == number("RAW_IMU")]


def test_an_old_ardupilot_is_asked_for_the_group():
    world = World(autopilot(slow={"RAW_IMU": 4.0, "SCALED_PRESSURE": 4.0}, old=True))
    service = asking(world)
    world.run(service, 60)
    assert world.pilot.hz["RAW_IMU"] == 50
    groups = [(m.fields["req_stream_id"], m.fields["req_message_rate"]) for m in world.pilot.groups]
    assert (1, 50) in groups
    assert len(groups) == len({group for group, _ in groups})  # each once
    for m in service.close(world.now_us):
        assert m.name == "REQUEST_DATA_STREAM"
        world.pilot.take(m, world.now_us)
    assert world.pilot.hz["RAW_IMU"] == 4
    # once it is known to be old it is not asked for intervals any more
    assert {m.fields["param1"] for m in world.pilot.commands} == {number("RAW_IMU")}


def test_px4_without_intervals_is_not_asked_for_groups():
    world = World(autopilot(PX4, {"SCALED_IMU": 4.0}, old=True))
    world.run(asking(world), 60)
    assert world.pilot.groups == []


def test_nothing_is_asked_over_a_telemetry_radio():
    world = World(autopilot(slow={"RAW_IMU": 4.0}))
    service = asking(world)
    radio = world.pilot.says("RADIO_STATUS", 0)._replace(system=51, component=68)

    world.run(service, 30, lambda s: world.post.append(radio))
    assert said([m for _, m in world.sent]) == []
    assert "a telemetry radio is on the link" in service.notes[0]


def test_a_link_that_pauses_is_no_slow_stream():
    world = World(autopilot())
    service = asking(world)
    world.run(service, 20)
    before = len(world.sent)
    for _ in range(5):
        world.pilot.quiet = True
        world.run(service, 2.0)
        world.pilot.quiet = False
        world.pilot.t_us += 2_000_000
        world.run(service, 5.0)
    assert said([m for _, m in world.sent[before:]]) == []
    assert service.notes == ()


def test_a_third_of_the_frames_lost_makes_no_stream_slow():
    world = World(autopilot(slow={"RAW_IMU": 50.0 * 0.65, "ATTITUDE": 20 * 0.65}))
    sent = {name for _, name, *_ in said(world.run(asking(world), 40))}
    assert not sent & {"RAW_IMU", "ATTITUDE"}


def test_nothing_is_asked_when_told_so():
    world = World(
        autopilot(slow={"RAW_IMU": 4.0}), ComponentSettings(listen_s=0, request_streams=False)
    )
    service = asking(world)
    assert said(world.run(service, 40)) == []
    assert "request_streams is false" in service.notes[0]


def test_a_rate_can_be_configured():
    world = World(
        autopilot(slow={"RAW_IMU": 4.0, "ATTITUDE": 1.0}),
        ComponentSettings(listen_s=0, stream_hz={"imu0": 100, "attitude": 0}),
    )
    service = asking(world)
    world.run(service, 40)
    assert world.pilot.hz["RAW_IMU"] == 100.0
    assert world.pilot.hz["ATTITUDE"] == 1.0
    assert service.notes == ()


def test_a_sensor_that_is_not_fitted_is_not_missed():
    world = World(autopilot())
    world.pilot.hz["SCALED_IMU2"] = 10.0  # streamed, but there is no second IMU
    service = asking(world)
    sent = said(world.run(service, 60))
    assert ("get", "SCALED_IMU2", 0.0, 0) in sent
    assert not [s for s in sent if s[:2] == ("set", "SCALED_IMU2")]
    assert service.notes == ()


def test_an_autopilot_that_sends_nothing_but_heartbeats_is_asked_for_all():
    world = World(autopilot(slow=dict.fromkeys(autopilot().hz, 0.0)))
    service = asking(world)
    assert world.run(service, 4.5) == []
    world.run(service, 60)
    assert service.notes == ()
    assert world.pilot.hz["RAW_IMU"] == 50
    for m in service.close(world.now_us):
        world.pilot.take(m, world.now_us)
    assert not any(world.pilot.hz.values())


def test_when_all_streams_stop_but_the_heartbeat_they_are_asked_for_once_more():
    world = World(autopilot(slow={"RAW_IMU": 4.0}))
    service = asking(world)
    world.run(service, 40)
    world.pilot.hz = dict.fromkeys(world.pilot.hz, 0.0)
    world.run(service, 60)
    assert world.pilot.hz["RAW_IMU"] == 50.0


def test_a_link_that_is_gone_is_not_talked_to():
    world = World(autopilot())
    service = asking(world)
    world.run(service, 40)
    world.pilot.quiet = True
    assert world.run(service, 120) == []


def test_the_text_names_some_streams_and_counts_the_rest():
    world = World(autopilot(slow=dict.fromkeys(autopilot().hz, 0.05), silent=True))
    (text,) = texts(world.run(asking(world), 60))
    assert text == "Streams slow: imu0 attitude gps0 +4"
    longest = sorted(map(len, NEEDS))[-3:]
    assert len("Streams slow: ") + sum(longest) + 2 + len(" +99") <= TEXT_MAX


def test_a_stream_of_zeros_is_no_sensor_that_is_missed():
    pilot = autopilot(slow={"SCALED_IMU2": 2.0})
    pilot.fitted |= {"imu1"}
    pilot.blank = frozenset({"imu1"})
    world = World(pilot)
    service = asking(world)
    world.run(service, 40)
    assert pilot.hz["SCALED_IMU2"] == 2.0
    assert service.notes == ()
