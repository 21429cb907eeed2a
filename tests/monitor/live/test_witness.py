"""What the log gets of a running daemon, second by second of a fake clock."""

from collections import Counter
from types import SimpleNamespace

import pytest

from links.vocabulary import Rejection, State
from monitor.commands.live.telling import Telling
from monitor.commands.live.witness import REFUSED_US, REPEAT_US, Witness, health
from monitor.service import Event
from monitor.settings import Settings
from monitor.settings.log import LogSettings
from monitor.verdict import StepResult, Verdict

S = 1_000_000


class FakeLog:
    def __init__(self):
        self.entries = []
        self.trouble = ""

    def log(self, event, message, grave="info", **fields):
        self.entries.append((event, message, grave, fields))

    def take(self, event):
        out = [entry[1:] for entry in self.entries if entry[0] is event]
        self.entries = [entry for entry in self.entries if entry[0] is not event]
        return out


class FakeNotifier:
    def __init__(self):
        self.said = []

    def wants_status(self, now_us):
        return True

    def status(self, text):
        self.said.append(text)


def link(name, is_open=True, trouble=""):
    return SimpleNamespace(name=name, kind="tcp", open=is_open, trouble=trouble)


class World:
    def __init__(self):
        self.us = 100 * S
        self.links = [link("tcp:a:1"), link("udpout:b:2")]
        self.notes = []
        self.news = []
        self.reception = SimpleNamespace(by_link=(Counter(), Counter()))
        self.states = {}
        self.running = SimpleNamespace(
            decoder=SimpleNamespace(vehicle=None),
            links=SimpleNamespace(
                hub=SimpleNamespace(names=("tcp:a:1", "udpout:b:2"), states=lambda: self.links),
                title="tcp:a:1",
            ),
            gate=SimpleNamespace(reception=self.reception),
            notes=lambda: tuple(self.notes),
            recorder=SimpleNamespace(stopped=None, news=self.take_news),
            pipeline=SimpleNamespace(states=lambda: self.states, flying=True),
            daemon=SimpleNamespace(status=lambda recent: SimpleNamespace(silent=False)),
        )
        self.log, self.said, self.notifier = FakeLog(), [], FakeNotifier()
        telling = Telling(self.log, LogSettings(to="file"), self.said.append)
        self.witness = Witness(self.running, telling, self.notifier, lambda: self.us)

    def take_news(self):
        out, self.news = self.news, []
        return out

    def turns(self, seconds=1.0, *verdicts):
        for k in range(round(seconds * 20)):
            self.witness(StepResult(list(verdicts) if k == 0 else []))
            self.us += S // 20


@pytest.fixture
def world():
    return World()


def test_each_verdict_is_an_event_as_grave_as_its_state(world):
    states = (State.OK, State.FAULTY, State.STALE)
    world.turns(0.05, *(Verdict(S, "aoa0", state, evidence="low") for state in states))
    entries = world.log.take(Event.VERDICT)
    assert [grave for _, grave, _ in entries] == ["info", "error", "warning"]
    assert [facts["state"] for _, _, facts in entries] == ["ok", "faulty", "stale"]
    assert entries[1][0].startswith("aoa0 faulty: ")


def test_links_are_told_when_they_change_and_not_between(world):
    world.turns(3.0)
    assert [m for m, _, _ in world.log.take(Event.LINK_UP)] == [
        "tcp:a:1 is open",
        "udpout:b:2 is open",
    ]
    world.links[0] = link("tcp:a:1", False, "connection refused")
    world.turns(3.0)
    assert world.log.take(Event.LINK_DOWN) == [
        (
            "tcp:a:1 is not open: connection refused",
            "warning",
            {"link": 0, "name": "tcp:a:1", "kind": "tcp"},
        )
    ]
    world.links[0] = link("tcp:a:1")
    world.turns(3.0)
    assert len(world.log.take(Event.LINK_UP)) == 1


def test_the_vehicle_is_told_once(world):
    world.turns(2.0)
    assert world.log.take(Event.VEHICLE) == []
    world.running.decoder.vehicle = SimpleNamespace(system_id=3, autopilot=3, type=1)
    world.turns(3.0)
    ((_, _, facts),) = world.log.take(Event.VEHICLE)
    assert facts == {"system_id": 3, "autopilot": 3, "type": 1}


def test_refusals_are_summed_up_however_many_there_are(world):
    world.turns(1.0)
    for _ in range(100):
        world.reception.by_link[1][Rejection.BAD_SIGNATURE] += 1000
        world.turns(0.5)
    entries = world.log.take(Event.REFUSED)
    assert 4 <= len(entries) <= 50 * S / REFUSED_US + 1
    assert sum(facts["counts"]["bad signature"] for _, _, facts in entries) >= 80_000
    assert {(grave, facts["link"]) for _, grave, facts in entries} == {("warning", 1)}


def test_what_every_network_has_is_no_warning(world):
    world.reception.by_link[0][Rejection.OWN_ECHO] += 10
    world.turns(1.0)
    assert [grave for _, grave, _ in world.log.take(Event.REFUSED)] == ["debug"]


def test_a_note_is_said_to_people_too_and_one_that_flaps_seldom(world):
    for k in range(100):
        world.notes = ["gps0 cannot be had"] if k % 2 else []
        world.turns(1.0)
    told = world.log.take(Event.NOTE)
    assert len(told) == len(world.said) == 1 + 100 * S // REPEAT_US
    assert world.said[0] == "mavsentry: gps0 cannot be had"


def test_what_the_recorder_says_is_an_event_of_its_own(world):
    world.news = ["recording goes on in b.tlog"]
    world.turns(2.0)
    world.running.recorder.stopped = "recording has stopped: no space left"
    world.news = world.notes = [world.running.recorder.stopped]
    world.turns(5.0)
    told = [(message, grave) for message, grave, _ in world.log.take(Event.RECORDER)]
    assert told == [
        ("recording goes on in b.tlog", "info"),
        ("recording has stopped: no space left", "warning"),
    ]
    assert world.log.take(Event.NOTE) == []
    assert len(world.said) == 2


def test_that_events_cannot_be_logged_is_said(world):
    world.log.trouble = "events cannot be logged: No space left on device"
    world.turns(2.0)
    assert world.said == ["mavsentry: events cannot be logged: No space left on device"]


def test_the_status_is_a_sentence_on_the_vehicle(world):
    assert health(world.running) == "no vehicle heard yet on tcp:a:1"
    world.running.decoder.vehicle = SimpleNamespace(system_id=3, autopilot=3, type=1)
    world.states = {
        "airspeed0": Verdict(S, "airspeed0", State.FAULTY),
        "aoa0": Verdict(S, "aoa0", State.OK),
    }
    world.turns(1.0)
    assert world.notifier.said[-1] == "vehicle 3 flying; 1 of 2 sensors ok; FAULTY: airspeed0"


def test_where_the_log_is_on_standard_error_nothing_is_said_twice(capsys):
    log = FakeLog()
    said = []
    for to in ("-", "journal", "file", ""):
        Telling(log, LogSettings(to=to), said.append)(Event.NOTE, to)
    assert said == ["mavsentry: file", "mavsentry: "]
    assert len(log.entries) == 4


def test_another_level_is_taken_and_another_place_waits():
    log = FakeLog()
    telling = Telling(log, LogSettings(to="here"))
    retuned = telling.retune(Settings(log=LogSettings(to="there", level="debug")))
    assert retuned.taken == ("log.level",)
    assert retuned.waiting == ("log.to",)
    assert log.level == "debug"
