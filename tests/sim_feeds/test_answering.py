"""An autopilot that thins its streams and answers, held against pymavlink and our own framer."""

from collections import Counter

from pymavlink.dialects.v20 import ardupilotmega as dialect

from links.mavlink import Decoder, Encoder
from sim_feeds.answering import AnsweringAutopilot

S = 1_000_000
ATTITUDE, RAW_IMU = 30, 27


def flown(pilot: AnsweringAutopilot, from_s: float, to_s: float) -> list[bytes]:
    """What goes out of 50 Hz attitudes, 100 Hz IMU and a heartbeat a second."""
    autopilot = Encoder(1, 1)
    out = []
    for k in range(round(from_s * 100), round(to_s * 100)):
        t_us = k * S // 100
        frames = [autopilot.encode("RAW_IMU", time_usec=t_us)]
        if k % 2 == 0:
            frames.append(autopilot.encode("ATTITUDE", time_boot_ms=t_us // 1000))
        if k % 100 == 0:
            frames.append(autopilot.encode("HEARTBEAT", type=1, autopilot=3))
        out += [f for frame in frames if (f := pilot.send(t_us, frame)) is not None]
    return out


def asked(pilot: AnsweringAutopilot, command: int, *params: float, target=(1, 1)) -> list:
    station = dialect.MAVLink(None, 1, 191)
    values = [*params, *[0.0] * (7 - len(params))]
    message = dialect.MAVLink_command_long_message(*target, command, 0, *values)
    parser = dialect.MAVLink(None)
    answers = pilot.hear(bytes(message.pack(station)), S)
    return [m for frame in answers for m in parser.parse_buffer(frame)]


def counts(frames: list[bytes]) -> Counter[int]:
    return Counter(int.from_bytes(f[7:10], "little") for f in frames)


def test_streams_begin_slow_and_become_as_fast_as_asked_for_and_possible():
    pilot = AnsweringAutopilot(1, hz=5)
    assert counts(flown(pilot, 0, 10)) == {ATTITUDE: 50, RAW_IMU: 50, 0: 10}
    interval, ack = asked(pilot, 510, ATTITUDE)
    assert (interval.message_id, interval.interval_us) == (ATTITUDE, 200_000)
    assert (ack.command, ack.result) == (510, 0)
    assert (ack.target_system, ack.target_component) == (1, 191)
    (ack,) = asked(pilot, 511, ATTITUDE, 40_000)
    assert ack.result == dialect.MAV_RESULT_ACCEPTED
    asked(pilot, 511, RAW_IMU, 1_000)
    later = counts(flown(pilot, 10, 20))
    assert later[RAW_IMU] == 1000  # no more than the flight has
    assert abs(later[ATTITUDE] - 250) <= 1
    asked(pilot, 511, ATTITUDE, -1)
    asked(pilot, 511, RAW_IMU, 0)
    assert counts(flown(pilot, 20, 30)) == {RAW_IMU: 50, 0: 10}


def test_what_is_left_out_leaves_no_gap_in_the_numbers():
    pilot = AnsweringAutopilot(1, hz=5)
    decoder = Decoder()
    decoder.feed(b"".join(flown(pilot, 0, 20)))
    assert decoder.counters.lost == decoder.counters.bad_bytes == 0
    assert decoder.counters.messages == 220


def test_it_answers_what_concerns_it_and_refuses_the_rest():
    pilot = AnsweringAutopilot(1, hz=5)
    assert asked(pilot, 511, ATTITUDE, 1e5, target=(1, 191)) == []
    assert asked(pilot, 511, ATTITUDE, 1e5, target=(2, 1)) == []
    assert asked(pilot, 400, 1)[0].result == dialect.MAV_RESULT_UNSUPPORTED
    assert asked(pilot, 511, 0, 1e5)[0].result == dialect.MAV_RESULT_FAILED
    assert asked(pilot, 510, ATTITUDE)[0].interval_us == -1  # not sent so far


def test_it_tells_its_time():
    pilot = AnsweringAutopilot(1, hz=5)
    station = dialect.MAVLink(None, 1, 191)
    request = bytes(dialect.MAVLink_timesync_message(0, 77).pack(station))
    (answer,) = dialect.MAVLink(None).parse_buffer(pilot.hear(request, 3 * S)[0])
    assert (answer.tc1, answer.ts1) == (3 * S * 1000, 77)
    assert pilot.hear(bytes(dialect.MAVLink_timesync_message(5, 77).pack(station)), S) == []
    assert pilot.hear(bytes(range(256)), S) == []
