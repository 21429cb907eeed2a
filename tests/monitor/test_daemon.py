"""The loop with fake time, a fake link and a fake pipeline: pace, silence, latency, bounds."""

from collections import deque

import numpy as np
import pytest

from links.samples import Batch, empty_rows
from links.vocabulary import State
from monitor.daemon import DATAGRAMS_MAX, IDLE_S, Daemon
from monitor.latency import LatencyMeter
from monitor.publish import Publisher
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


class FakeLink:
    """Datagrams at planned host times; waiting for one moves the fake clock."""

    def __init__(self, host, plan=()):
        self.host = host
        self.plan = deque(plan)
        self.sent = []
        self.receptions = 0

    def recv(self, timeout_s):
        self.receptions += 1
        end_us = self.host.us + round(timeout_s * S)
        if self.plan and self.host.us < self.plan[0][1] <= end_us:
            self.host.us = self.plan[0][1]
        elif not self.plan or self.plan[0][1] > end_us:
            self.host.us = end_us
            return []
        out = []
        while self.plan and self.plan[0][1] <= self.host.us:
            data, _ = self.plan.popleft()
            out.append((data, self.host.us))
        return out

    def send(self, data):
        self.sent.append((self.host.us, data))


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


def build(plan=(), work_us=0, coalesce_ms=20.0, record=None):
    host = FakeHost()
    link = FakeLink(host, plan)
    decoder = FakeDecoder()
    daemon = Daemon(
        link,
        [link],
        decoder,
        FakePipeline(host, work_us),
        Publisher(PublishSettings()),
        lambda m: m.name.encode() + b" " + str(m.fields.get("name", "")).encode(),
        LinkSettings(coalesce_ms=coalesce_ms),
        record,
        host,
    )
    return daemon, host, link, decoder


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

    class Trickle(FakeLink):
        def recv(self, timeout_s):
            if self.plan and self.plan[0][1] <= self.host.us:
                return [self.plan.popleft()]
            return super().recv(timeout_s) if timeout_s else []

    daemon, host, _, decoder = build()
    daemon._source = Trickle(host, flood)
    host.us += 2000
    daemon.turn()
    assert len(decoder.feeds[0]) == DATAGRAMS_MAX
    daemon.turn()
    daemon.turn()
    assert daemon.status().rows == 3 * DATAGRAMS_MAX


def test_finishing_judges_and_sends_what_still_waited():
    daemon, host, link, _ = build(steady(1.0, 50))
    spin(daemon, host, 1.0)
    result = daemon.finish()
    assert [v.sensor for v in result.verdicts] == ["aoa0"]
    assert link.sent[-1][0] == host.us


class FakeRecorder:
    def __init__(self):
        self.taken, self.sent = [], []

    def take(self, data, host_us):
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
