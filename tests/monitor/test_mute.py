"""What is said of a sensor that an operator has muted, and what comes back when he unmutes it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as effort
from hypothesis import strategies as st

from links.samples import Batch, Rows, empty_rows
from links.vocabulary import Reason, State
from monitor.masks import SENSORS
from monitor.mute import Muting
from monitor.pipeline import Pipeline
from monitor.publish import Publisher
from monitor.report.remedies import remedy
from monitor.retune import Retuned, with_values
from monitor.settings import Settings
from monitor.settings.mute import MuteSettings
from monitor.verdict import StepResult, Verdict
from monitor.warmup import made_up_flight

PITOT = {"mute.air": 1}
BASE = Settings()


def muted(**masks: int) -> Settings:
    return with_values(BASE, {f"mute.{mask}": bits for mask, bits in masks.items()})


class Says:
    """A watch that says what it is told to, at the times of imu0's rows."""

    name = "says"
    quantities = frozenset({"airspeed"})

    def __init__(self, states: list[State]) -> None:
        self.states = states

    def step(self, rows: Mapping[str, Rows], until_us: int) -> StepResult:
        out = StepResult()
        for t_us in rows.get("airspeed0", empty_rows("airspeed0"))["t_us"]:
            if self.states:
                out.verdicts.append(Verdict(int(t_us), "airspeed0", self.states.pop(0)))
        return out

    def retune(self, settings: Settings) -> Retuned:
        return Retuned()


def at(*times_s: float) -> Batch:
    rows = empty_rows("airspeed0", len(times_s))
    rows["t_us"] = np.array(times_s) * 1e6
    rows["seq"] = np.array(times_s) * 10
    return Batch({"airspeed0": rows})


def heard(result: StepResult) -> list[tuple[float, str, str | None]]:
    return [(v.t_us / 1e6, str(v.state), v.reason and str(v.reason)) for v in result.verdicts]


MUTED = "muted by the operator"


def test_a_fault_is_silenced_at_once_and_comes_back_as_it_is_now() -> None:
    pipeline = Pipeline(BASE, watches=[Says([State.OK, State.FAULTY, State.OK, State.FAULTY])])
    assert heard(pipeline.feed(at(1.0, 2.0, 2.5)))[-1] == (2.0, "faulty", None)
    assert pipeline.retune(muted(air=1)) == Retuned(("mute.air",))
    assert heard(pipeline.feed(at(3.0))) == [(2.1, "unmonitored", MUTED)]  # as far as was judged
    assert heard(pipeline.feed(at(3.5))) == []  # faulty again, unheard
    assert pipeline.states()["airspeed0"].reason is Reason.MUTED
    pipeline.retune(BASE)
    (back,) = pipeline.feed(at(4.0)).verdicts
    assert (back.t_us, back.state) == (3_100_000, State.FAULTY)
    assert pipeline.states()["airspeed0"] == back


def test_muted_before_anything_was_said_it_is_said_once() -> None:
    pipeline = Pipeline(muted(air=1), watches=[Says([State.OK, State.FAULTY, State.OK])])
    result = pipeline.feed(at(1.0, 2.0, 3.0, 4.0))
    assert heard(result) == [(1.0, "unmonitored", MUTED)]


def test_a_muted_sensor_that_stops_is_stale_only_when_it_is_heard_again() -> None:
    pipeline = Pipeline(BASE, watches=[Says([State.OK])])
    pipeline.feed(at(1.0, 1.5))
    pipeline.retune(muted(air=1))
    clock = empty_rows("attitude", 1)
    clock["t_us"], clock["seq"] = 9_000_000, 99
    assert heard(pipeline.feed(Batch({"attitude": clock}))) == [(1.1, "unmonitored", MUTED)]
    assert pipeline.states()["airspeed0"].reason is Reason.MUTED
    pipeline.retune(BASE)
    assert [str(v.state) for v in pipeline.finish().verdicts if v.sensor == "airspeed0"] == [
        "stale"
    ]
    assert pipeline.states()["airspeed0"].state is State.STALE


def test_flags_and_monitor_bits_go_and_come_back_in_a_flight() -> None:
    flight = made_up_flight(18.0)
    whole = Pipeline(muted(imu0=63, air=1 | 1 << 8, eng=1))
    publisher = Publisher(BASE.publish)
    for result in (whole.feed(flight), whole.finish()):
        assert not any(v.state is State.FAULTY for v in result.verdicts)
        publisher.note(result)
    sent = {m.fields["name"]: m.fields["value"] for m in publisher.due(0, 0, False)
            if m.name == "NAMED_VALUE_FLOAT"}  # fmt: skip
    assert (sent["FLT_IMU0"], sent["MON_IMU0"], sent["MON_IMU1"]) == (0, 0, 63)
    assert (sent["FLT_AIR"], sent["MON_AIR"]) == (0, 0b110_0000_0110)
    whole.retune(BASE)
    publisher.note(whole.finish())
    sent = {m.fields["name"]: m.fields["value"] for m in publisher.due(10**6, 0, False)
            if m.name == "NAMED_VALUE_FLOAT"}  # fmt: skip
    assert (sent["FLT_IMU0"], sent["FLT_AIR"], sent["FLT_ENG"]) == (1, 1 | 1 << 8, 1)


def test_what_others_say_is_not_changed_by_muting() -> None:
    flight = made_up_flight(18.0)

    def told(settings: Settings) -> list[str]:
        pipeline = Pipeline(settings)
        verdicts = pipeline.feed(flight).verdicts + pipeline.finish().verdicts
        return [repr(v) for v in verdicts if not v.sensor.startswith(("imu0", "airspeed0"))]

    assert told(BASE) == told(muted(imu0=63, air=1))
    assert told(BASE)


def test_one_that_is_not_there_stays_absent() -> None:
    muting = Muting(frozenset({"imu2.acc_x", "imu2"}))
    verdict = Verdict(5, "imu2", State.ABSENT)
    assert muting.hear([verdict]) == [verdict]


@pytest.mark.parametrize("mask", SENSORS)
def test_every_mask_mutes_its_sensors_and_bits_without_one_mute_nothing(mask: str) -> None:
    field = mask.lower()
    every = MuteSettings.model_validate({field: (1 << 24) - 1})
    assert every.sensors == frozenset(SENSORS[mask].values())
    for bit, sensor in SENSORS[mask].items():
        assert MuteSettings.model_validate({field: 1 << bit}).sensors == {sensor}


def test_the_report_says_what_it_means() -> None:
    assert remedy(Reason.MUTED, "airspeed0").meaning


_sensors = st.sampled_from(["airspeed0", "airspeed1", "imu0.acc_x"])
_moves = st.one_of(
    st.tuples(_sensors, st.sampled_from(list(State))),
    st.frozensets(_sensors),
)


@given(st.lists(_moves, max_size=30))
@effort(deadline=None)
def test_what_is_said_follows_from_what_is_so_and_what_is_muted(
    moves: list[tuple[str, State] | frozenset[str]],
) -> None:
    """Against the plain rule: a sensor's newest verdict, hidden if it is muted now."""
    muting, now, so = Muting(), frozenset[str](), dict[str, State]()
    said: dict[str, tuple[State, Reason | None]] = {}
    for t_us, move in enumerate(moves):
        if isinstance(move, frozenset):
            now, out = move, muting.mute(move, t_us)
        else:
            so[move[0]], out = move[1], muting.hear([Verdict(t_us, *move)])
        for verdict in out:
            assert verdict.t_us == t_us
            said[verdict.sensor] = verdict.state, verdict.reason
        assert said == {
            s: (State.UNMONITORED, Reason.MUTED)
            if s in now and state is not State.ABSENT
            else (state, None)
            for s, state in so.items()
        }
        assert {s: (v.state, v.reason) for s, v in muting.said.items()} == said
