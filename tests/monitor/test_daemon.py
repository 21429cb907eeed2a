"""The loop with fake time, a fake link and a fake pipeline: pace, silence, latency, bounds."""

from collections import deque

import numpy as np
import pytest

from links.endpoints.hub import Arrival
from links.mavlink import Encoder
from links.mavlink.heard import Heard
from links.mavlink.reception import Reception, ReceptionOptions
from links.samples import Batch, empty_rows
from links.vocabulary import Rejection, State
from monitor.daemon import DATAGRAMS_MAX, IDLE_S, Daemon, Parts
from monitor.latency import LatencyMeter
from monitor.outbox import Outbox
from monitor.publish import Message, Publisher
from monitor.security import Gate
from monitor.settings import Settings
from monitor.settings.links import LinkSettings
from monitor.settings.publish import PublishSettings
from monitor.verdict import StepResult, Verdict

S = 1_000_000


class FakeHost:
    def __init__(self):
        self.us = 50 * S
        self.slept_us = 0

    def now_us(self):
        return self.us

    def sleep(self, seconds):
        self.us += round(seconds * S)
        self.slept_us += round(seconds * S)


class FakeHub:
    """Datagrams at planned host times; waiting for one moves the fake clock."""

    def __init__(self, host, plan=()):
        self.host = host
        self.plan = deque(plan)
        self.sent = []
        self.on = []
        self.believed = []
        self.tended_us = []

    def recv(self, timeout_s):
        end_us = self.host.us + round(timeout_s * S)
        if self.plan and self.host.us < self.plan[0][1] <= end_us:
            self.host.us = self.plan[0][1]
        elif not self.plan or self.plan[0][1] > end_us:
            self.host.us = end_us
            return []
        out = []
        while self.plan and self.plan[0][1] <= self.host.us:
            data, _, *link = self.plan.popleft()
            out.append(Arrival(*(link or [0]), data, self.host.us, None))
        return out

    def send(self, data, link):
        self.sent.append((self.host.us, data))
        self.on.append(link)

    def accepted(self, link, peer):
        self.believed.append((link, peer))

    def tend(self, now_us):
        self.tended_us.append(now_us)


class FakeDecoder:
    """Each byte of the stream is a row of airspeed0, 20 ms of vehicle time after the last."""

    def __init__(self):
        self.seen = 0
        self.feeds = []

    def feed(self, data, host_us=None):
        self.feeds.append(data)
        rows = empty_rows("airspeed0", data.count(b"v"))
        rows["t_us"] = (self.seen + np.arange(len(rows))) * 20_000
        self.seen += len(rows)
        return Batch({"airspeed0": rows} if len(rows) else {})

    def finish(self):
        return Batch()


class FakePipeline:
    """Takes ``work_us`` per batch and says that airspeed0 is faulty at row 100."""

    def __init__(self, host, work_us=0):
        self.host, self.work_us, self.rows = host, work_us, 0

    def feed(self, batch):
        self.host.us += self.work_us
        before, self.rows = self.rows, self.rows + len(batch)
        if before < 100 <= self.rows:
            return StepResult([Verdict(100 * 20_000, "airspeed0", State.FAULTY)])
        return StepResult()

    def finish(self):
        return StepResult([Verdict(9 * S, "aoa0", State.FAULTY)])


class FakeComponent:
    """Answers what it hears on the link where it heard it, and says goodbye."""

    def __init__(self, address):
        self.address = address
        self.heard = []

    def hear(self, heard, now_us):
        self.heard.append(heard)
        return [Message("COMMAND_ACK", {"command": 7}, heard.link)]

    def due(self, now_us):
        return []

    def close(self, now_us):
        return [Message("STATUSTEXT", {"text": "goodbye"})]


class FakeOutbox(Outbox):
    """Frames that a person can read."""

    def _frame(self, message, address, link):
        return f"{message.name} {message.fields.get('name', '')}".encode()


def build(
    plan=(), work_us=0, coalesce_ms=20.0, record=None, links=1, address=(1, 191), pipeline=None
):
    host = FakeHost()
    hub = FakeHub(host, plan)
    decoder = FakeDecoder()
    component = FakeComponent(address)
    options = ReceptionOptions()
    reception = Reception(options, [f"link {k}" for k in range(links)], wants=["COMMAND_LONG"])
    parts = Parts(
        hub,
        Gate(reception),
        decoder,
        pipeline or FakePipeline(host, work_us),
        Publisher(PublishSettings()),
        component,
        FakeOutbox(hub.send, range(links), lambda: component.address),
    )
    return Daemon(parts, LinkSettings(coalesce_ms=coalesce_ms), record, host), host, hub, decoder


def steady(seconds, hz, start_us=50 * S + 1000):
    return [(b"v", start_us + round(k * S / hz)) for k in range(round(seconds * hz))]


def spin(daemon, host, seconds):
    end = host.us + round(seconds * S)
    results = []
    while host.us < end:
        results.append(daemon.turn())
    return results


def test_a_fast_stream_is_worked_on_at_most_once_per_gathering_time():
    daemon, host, _, decoder = build(steady(4.0, 200))
    spin(daemon, host, 4.0)
    assert sum(map(len, decoder.feeds)) == 800
    assert len(decoder.feeds) == pytest.approx(200, abs=4)


def test_a_datagram_after_a_pause_is_worked_on_at_once():
    daemon, host, _, _ = build([(b"v", 50 * S + 700_000)])
    while daemon.status().rows == 0:
        daemon.turn()
    assert host.us == 50 * S + 700_000


def test_no_gathering_works_on_every_datagram():
    daemon, host, _, decoder = build(steady(1.0, 200), coalesce_ms=0.0)
    spin(daemon, host, 1.0)
    assert len(decoder.feeds) == 200


def test_an_idle_link_still_beats_once_a_second_and_says_emergency():
    daemon, host, link, _ = build()
    spin(daemon, host, 10.0)
    beats = [t for t, data in link.sent if data.startswith(b"HEARTBEAT")]
    assert len(beats) == 10
    assert max(np.diff(beats)) <= S + IDLE_S * S
    assert daemon.status().silent
    assert daemon.status().t_us is None


def test_the_link_falls_silent_after_the_configured_time_and_comes_back():
    plan = steady(2.0, 50) + steady(1.0, 50, start_us=50 * S + 9 * S)
    daemon, host, _, _ = build(plan)
    spin(daemon, host, 4.5)
    assert not daemon.status().silent
    spin(daemon, host, 1.0)
    assert daemon.status().silent
    spin(daemon, host, 4.0)
    assert not daemon.status().silent


def test_bytes_that_give_no_sample_do_not_count_as_the_vehicle():
    daemon, host, _, _ = build([(b"x", 50 * S + k * 20_000) for k in range(1, 200)])
    spin(daemon, host, 4.0)
    assert daemon.status().datagrams > 100
    assert daemon.status().silent


def test_a_verdict_leaves_in_the_turn_that_found_it():
    daemon, host, link, _ = build(steady(4.0, 50))
    while not any(r.verdicts for r in [daemon.turn()]):
        pass
    newest = [data for t, data in link.sent if t == host.us]
    assert b"NAMED_VALUE_FLOAT FLT_AIR" in newest
    assert b"STATUSTEXT " in newest


def test_latency_counts_waiting_for_the_gathering_and_for_the_last_turns_work():
    daemon, host, _, _ = build(steady(6.0, 200), work_us=30_000)
    spin(daemon, host, 6.0)
    latency = daemon.status().latency
    assert latency.count > 5
    # Work takes longer than the gathering, so a datagram waits for up to one turn's work and then
    # for its own: anything under 60 ms would hide the queueing.
    assert 55.0 <= latency.p99_ms <= 65.0


def test_a_flood_is_bounded_per_turn_and_not_lost():
    flood = [(b"v", 50 * S + 1000)] * (3 * DATAGRAMS_MAX)

    class Trickle(FakeHub):
        def recv(self, timeout_s):
            if self.plan and self.plan[0][1] <= self.host.us:
                data, host_us = self.plan.popleft()
                return [Arrival(0, data, host_us, None)]
            return super().recv(timeout_s) if timeout_s else []

    daemon, host, _, decoder = build()
    daemon._links = Trickle(host, flood)
    host.us += 2000
    daemon.turn()
    assert len(decoder.feeds[0]) == DATAGRAMS_MAX
    daemon.turn()
    daemon.turn()
    assert daemon.status().rows == 3 * DATAGRAMS_MAX


def test_finishing_judges_and_sends_what_still_waited_and_says_goodbye_last():
    daemon, host, link, _ = build(steady(1.0, 50))
    spin(daemon, host, 1.0)
    link.sent.clear()
    result = daemon.finish()
    assert [v.sensor for v in result.verdicts] == ["aoa0"]
    kinds = [data for _, data in link.sent]
    assert b"NAMED_VALUE_FLOAT FLT_AIR" in kinds
    assert kinds[-1] == b"STATUSTEXT "


def test_nothing_leaves_while_we_have_no_address():
    daemon, host, hub, _ = build(steady(3.0, 50), address=None)
    spin(daemon, host, 3.0)
    assert daemon.status().rows > 100
    assert hub.sent == []
    daemon._component.address = (1, 192)
    daemon.turn()
    assert b"HEARTBEAT " in {data for _, data in hub.sent}
    assert b"NAMED_VALUE_FLOAT FLT_AIR" in {data for _, data in hub.sent}


def command():
    return Encoder(255, 190).encode("COMMAND_LONG", command=512, target_system=1)


def test_a_message_for_us_is_answered_in_its_turn_on_its_own_link():
    daemon, host, hub, _ = build([(command(), 50 * S + 700_000, 1)], links=3)
    spin(daemon, host, 1.0)
    (heard,) = daemon._component.heard
    assert isinstance(heard, Heard)
    assert (heard.name, heard.system, heard.link) == ("COMMAND_LONG", 255, 1)
    answers = [(t, on) for (t, d), on in zip(hub.sent, hub.on, strict=True) if b"ACK" in d]
    assert answers == [(50 * S + 700_000, 1)]
    assert hub.believed == [(1, None)]


def test_what_came_in_is_never_sent_on():
    plan = [(command(), 50 * S + k * 10_000, k % 2) for k in range(1, 300)]
    daemon, host, hub, _ = build(plan, links=2)
    spin(daemon, host, 4.0)
    assert len(daemon._component.heard) == 299
    assert {data.split(b" ")[0] for _, data in hub.sent} == {b"HEARTBEAT", b"COMMAND_ACK"}


def test_what_is_published_leaves_on_every_output():
    daemon, host, hub, _ = build(steady(1.5, 50), links=3)
    spin(daemon, host, 1.5)
    beats = [on for (_, data), on in zip(hub.sent, hub.on, strict=True) if b"HEART" in data]
    assert beats == [0, 1, 2] * 2
    assert daemon.status().sent * 3 == len(hub.sent)


def test_refused_frames_are_counted_with_the_rest():
    class Keeping(FakePipeline):
        def feed(self, batch):
            self.rejected = getattr(self, "rejected", 0) + batch.rejected.total()
            self.reasons = batch.rejected or getattr(self, "reasons", None)
            return super().feed(batch)

    secret = Encoder(255, 190).encode("SETUP_SIGNING")
    pipeline = Keeping(FakeHost())
    daemon, host, _, decoder = build([(secret, 51 * S, 1)] * 3, links=2, pipeline=pipeline)
    spin(daemon, host, 2.0)
    assert daemon.status().refused == pipeline.rejected == 3
    assert set(pipeline.reasons) == {("frame", Rejection.SECRET)}
    assert not any(decoder.feeds)


def test_links_are_tended_in_every_turn_also_without_traffic():
    daemon, host, hub, _ = build()
    turns = len(spin(daemon, host, 5.0))
    assert len(hub.tended_us) == turns
    assert max(np.diff(hub.tended_us)) <= IDLE_S * S


def test_new_times_are_taken_in_flight_and_other_keys_of_the_links_wait():
    daemon, host, _, decoder = build(steady(8.0, 200))
    spin(daemon, host, 2.0)
    links = LinkSettings(coalesce_ms=50.0, silent_after_s=0.5, component_id=7)
    retuned = daemon.retune(Settings(links=links))
    assert set(retuned.taken) == {"links.coalesce_ms", "links.silent_after_s"}
    assert retuned.waiting == ("links.component_id",)
    feeds = len(decoder.feeds)
    spin(daemon, host, 4.0)
    assert len(decoder.feeds) - feeds == pytest.approx(80, abs=4)
    spin(daemon, host, 3.0)
    assert daemon.status().silent


def test_the_longest_gap_between_heartbeats_is_kept():
    daemon, host, _, _ = build(steady(10.0, 50))
    spin(daemon, host, 4.0)
    assert daemon.status().beat_gap_s == pytest.approx(1.0, abs=IDLE_S)
    host.us += 2 * S  # the loop hung
    spin(daemon, host, 4.0)
    assert daemon.status().beat_gap_s == pytest.approx(3.0, abs=1.0)


class FakeRecorder:
    def __init__(self):
        self.taken, self.sent = [], []

    def take(self, data, host_us, link):
        self.taken.append((data, host_us))

    def take_sent(self, frame, host_us):
        self.sent.append((host_us, frame))


def test_everything_received_is_recorded_in_order():
    record = FakeRecorder()
    daemon, host, _, decoder = build(steady(1.0, 100), record=record)
    spin(daemon, host, 1.2)
    assert b"".join(d for d, _ in record.taken) == b"".join(decoder.feeds)
    assert len(record.taken) == 100
    assert [t for _, t in record.taken] == sorted(t for _, t in record.taken)


def test_what_is_sent_is_recorded_once_the_vehicle_is_known():
    record = FakeRecorder()
    daemon, host, link, _ = build(steady(3.0, 50, start_us=52 * S), record=record)
    spin(daemon, host, 5.0)
    assert link.sent[0][0] < 51 * S
    assert record.sent == [sent for sent in link.sent if sent[0] >= 52 * S]
    assert b"NAMED_VALUE_FLOAT FLT_AIR" in {frame for _, frame in record.sent}


def test_the_latency_meter_keeps_the_newest():
    meter = LatencyMeter(size=100)
    assert meter.read().count == 0
    for k in range(1000):
        meter.add(k)
    read = meter.read()
    assert read.count == 1000
    assert read.worst_ms == pytest.approx(0.999)
    assert read.median_ms == pytest.approx(0.9495)


@pytest.mark.parametrize("count", [1, 2, 3, 99, 256, 1000])
def test_latencies_are_quantiles_of_the_newest(count):
    meter = LatencyMeter(256)
    taken = np.random.default_rng(count).exponential(20_000.0, count)
    for latency_us in taken:
        meter.add(latency_us)
    latency = meter.read()
    expected = np.quantile(taken[-256:] / 1e3, (0.5, 0.99, 1.0))
    assert latency.count == count
    assert (latency.median_ms, latency.p99_ms, latency.worst_ms) == pytest.approx(tuple(expected))
