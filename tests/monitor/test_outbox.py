"""Frames as they leave: numbered per link, signed per link, bounded, nothing before an address."""

from links.mavlink.dialect import load_dialect
from links.mavlink.framing import Framer
from monitor.outbox import WAITING_MAX, Outbox
from monitor.publish import Message

BEAT = Message("HEARTBEAT", {"type": 18, "autopilot": 8})


class Wire:
    def __init__(self, outputs=(0, 1), address=(7, 191), **more):
        self.frames = []
        self.address = address
        self.told = []
        self.outbox = Outbox(
            lambda data, link: self.frames.append((link, data)),
            outputs,
            lambda: self.address,
            sent=self.told.append,
            **more,
        )

    def send(self, *messages):
        self.outbox.put(messages)
        return self.outbox.flush()

    def on(self, link):
        """System, component and sequence of the frames of a link."""
        framer = Framer(load_dialect())
        data = b"".join(frame for number, frame in self.frames if number == link)
        frames = framer.feed(data)
        assert framer.pending == 0
        return [(int(r.system), int(r.component), int(r.sequence)) for r in rows(frames)]


def rows(frames):
    class Row:
        def __init__(self, frame):
            self.sequence, self.system, self.component = frame[4], frame[5], frame[6]

    pairs = zip(frames.start.tolist(), frames.end.tolist(), strict=True)
    return [Row(frames.data[start:end]) for start, end in pairs]


def test_a_message_goes_out_on_every_output_or_on_its_own_link():
    wire = Wire(outputs=(0, 2))
    wire.send(BEAT, Message("COMMAND_ACK", {"command": 1}, link=1))
    assert [link for link, _ in wire.frames] == [0, 2, 1]


def test_frames_are_numbered_per_link():
    wire = Wire()
    ask = Message("TIMESYNC", {"ts1": 1}, link=1)
    wire.send(BEAT, ask, ask, BEAT)
    wire.send(BEAT)
    assert wire.on(0) == [(7, 191, 0), (7, 191, 1), (7, 191, 2)]
    assert wire.on(1) == [(7, 191, k) for k in range(5)]


def test_each_message_gives_the_frame_that_left_first_and_all_are_told():
    wire = Wire()
    first = wire.send(BEAT, Message("TIMESYNC", {"ts1": 1}, link=1))
    assert first == [wire.frames[0][1], wire.frames[2][1]]
    assert wire.told == [frame for _, frame in wire.frames]


def test_before_there_is_an_address_nothing_leaves_and_nothing_waits():
    wire = Wire(address=None)
    assert wire.send(BEAT) == []
    wire.address = (1, 191)
    assert wire.outbox.flush() == []
    assert wire.frames == []


def test_the_address_may_change():
    wire = Wire(outputs=(0,))
    wire.send(BEAT)
    wire.address = (9, 192)
    wire.send(BEAT)
    assert [row[:2] for row in wire.on(0)] == [(7, 191), (9, 192)]


def test_signing_is_of_each_link():
    wire = Wire(sign=lambda frame, link: frame + bytes([link]))
    wire.send(BEAT)
    assert [(link, frame[-1]) for link, frame in wire.frames] == [(0, 0), (1, 1)]
    assert wire.told == [frame for _, frame in wire.frames]


def test_too_many_answers_drop_the_oldest_and_are_counted():
    wire = Wire(outputs=(0,))
    wire.outbox.put(Message("PING", {"seq": k}) for k in range(WAITING_MAX + 10))
    wire.send(BEAT)
    assert wire.outbox.dropped == 11
    assert len(wire.frames) == WAITING_MAX
    assert wire.frames[0][1][18] == 11  # low byte of seq
    assert wire.frames[-1][1][7] == 0


def test_what_the_dialect_cannot_hold_is_counted_and_the_rest_leaves():
    wire = Wire(outputs=(0,))
    wrong = Message("COMMAND_ACK", {"command": 1 << 20})
    assert len(wire.send(BEAT, wrong, Message("NO_SUCH", {}), BEAT)) == 2
    count, why = wire.outbox.unfit
    assert count == 2
    assert "NO_SUCH" in why
    assert [row[2] for row in wire.on(0)] == [0, 1]
