"""New settings in flight: nothing is lost, nothing is taken by half, what waits is named."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from annotated_types import Ge, Gt, Le, Lt
from hypothesis import given
from hypothesis import settings as effort
from hypothesis import strategies as st
from pydantic import ValidationError

from links.samples import Batch
from links.vocabulary import State
from monitor.pipeline import Pipeline
from monitor.publish import Publisher
from monitor.retune import Retuned, blend, differing, value_of, with_values
from monitor.settings import PROFILES, Settings, load
from monitor.settings.base import Section
from monitor.verdict import StepResult
from monitor.warmup import made_up_flight

SECTIONS = ("streams", "phase", "imu", "air", "triplex", "vane", "engine", "wing")
WAITING = {
    "streams.horizon_s",
    "streams.gps_latency_s",
    "streams.pending_rows",
    "air.gust_prior_m_s",
    "air.gust_tau_s",
    "air.horizon.horizon_s",
    "air.horizon.stage_s",
    "engine.throttle_idle_us",
    "engine.throttle_full_us",
    "engine.tick_s",
    "engine.timing_s",
    "engine.memory_s",
}
"""Of the numbers, beside the model of the engine and all of the wings but their limits."""


@pytest.fixture(scope="module")
def flight() -> Batch:
    return made_up_flight(18.0)


BASES = {
    "votes": Settings(),
    "bank": Settings.model_validate({"air": {"method": "bank"}, "wing": {"airframe": "aerosonde"}}),
}


def numbers(section: Section, prefix: str = "") -> Iterator[tuple[str, float | int]]:
    """Dotted keys of all numbers."""
    for key in type(section).model_fields:
        value = getattr(section, key)
        if isinstance(value, Section):
            yield from numbers(value, f"{prefix}{key}.")
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield prefix + key, value


def other(base: Settings, key: str, share: float = 0.07) -> float | int:
    """Another value that the key may have."""
    section: Any = base
    *path, name = key.split(".")
    for part in path:
        section = getattr(section, part)
    value, rules = getattr(section, name), type(section).model_fields[name].metadata
    most = min((r.le for r in rules if isinstance(r, Le)), default=np.inf)
    below = min((r.lt for r in rules if isinstance(r, Lt)), default=np.inf)
    least = max((r.ge for r in rules if isinstance(r, Ge)), default=-np.inf)
    least = max((r.gt for r in rules if isinstance(r, Gt)), default=least)
    if isinstance(value, int):
        return value + 1 if value + 1 <= most and value + 1 < below else value - 1
    up, down = value * (1 + share) + 1e-6, value * (1 - share)
    return up if up <= most and up < below else down if down > least else value


def changed(base: Settings, keys: set[str] | frozenset[str] | list[str]) -> Settings:
    return with_values(base, {key: other(base, key) for key in keys})


def keys_of(base: Settings) -> list[str]:
    return [k for name in SECTIONS for k, _ in numbers(getattr(base, name), f"{name}.")]


def fly(pipeline: Pipeline, batch: Batch, at: dict[int, Settings] | None = None) -> StepResult:
    """The whole flight in pieces; before the numbered pieces new settings come."""
    out = StepResult()
    size = len(batch) // 30
    pieces = list(batch.split(range(0, len(batch), size)))
    for i, piece in enumerate([*pieces, None]):
        if at and i in at:
            pipeline.retune(at[i])
        step = pipeline.finish() if piece is None else pipeline.feed(piece)
        out.verdicts += step.verdicts
        for name, rows in step.estimates.items():
            before = out.estimates.get(name)
            out.estimates[name] = rows if before is None else np.concatenate((before, rows))
    return out


def same(one: StepResult, two: StepResult) -> bool:
    """To the last bit."""
    return (
        list(map(repr, one.verdicts)) == list(map(repr, two.verdicts))
        and one.estimates.keys() == two.estimates.keys()
        and all(rows.tobytes() == two.estimates[n].tobytes() for n, rows in one.estimates.items())
    )


# ---------------------------------------------------------------------------- the mixture


def test_keys_that_differ_are_named_and_those_that_are_fixed_wait() -> None:
    old = Settings()
    new = changed(old, ["imu.single_sigma", "air.horizon.stage_s", "air.horizon.margin_one"])
    assert differing(old, new) == (
        "imu.single_sigma",
        "air.horizon.stage_s",
        "air.horizon.margin_one",
    )
    mixed, done = blend(old, new, ("air.horizon.stage_s",))
    assert done == Retuned(("imu.single_sigma", "air.horizon.margin_one"), ("air.horizon.stage_s",))
    assert mixed.air.horizon.stage_s == old.air.horizon.stage_s
    assert mixed.air.horizon.margin_one == new.air.horizon.margin_one
    whole, waits = blend(old, new, ("air.horizon", "imu"))
    assert whole == old
    assert len(waits.waiting) == 3


def test_a_table_of_free_names_is_one_key() -> None:
    channel = {"range_rpm": 9000.0, "noise_rpm": 20.0}
    old = Settings.model_validate({"engine": {"channels": {"spool0": channel}}})
    new = Settings.model_validate({"engine": {"channels": {"spool1": channel}}})
    assert differing(old, new) == ("engine.channels",)


# ---------------------------------------------------------------------------- the pipeline


@pytest.mark.parametrize("name", BASES)
def test_the_same_settings_change_nothing_to_the_last_bit(name: str, flight: Batch) -> None:
    base = BASES[name]
    plain = fly(Pipeline(base), flight)
    again = Settings.model_validate(base.model_dump())
    pipeline = Pipeline(base)
    assert pipeline.retune(again) == Retuned()
    assert same(plain, fly(pipeline, flight, dict.fromkeys(range(31), again)))


@pytest.mark.parametrize("name", BASES)
def test_settings_taken_before_the_first_row_are_as_good_as_started_with(
    name: str, flight: Batch
) -> None:
    base = BASES[name]
    every = changed(base, keys_of(base))
    pipeline = Pipeline(base)
    done = pipeline.retune(every)
    assert set(done.taken).isdisjoint(done.waiting)
    assert set(done.taken + done.waiting) == set(differing(base, every))
    model = ("wing.", "engine.single_shaft.", "engine.two_spool.")
    assert {k for k in done.waiting if not k.startswith(model)} == WAITING
    taken = with_values(base, {key: value_of(every, key) for key in done.taken})
    assert pipeline.settings == taken
    assert same(fly(pipeline, flight), fly(Pipeline(taken), flight))


def test_the_property_can_fail(flight: Batch) -> None:
    """Other settings do give another flight, so the comparison above says something."""
    base = BASES["bank"]
    for key in ("imu.gps_std_m_s", "engine.power_time_s"):
        assert not same(fly(Pipeline(base), flight), fly(Pipeline(changed(base, [key])), flight))


def test_what_waits_changes_nothing(flight: Batch) -> None:
    base = BASES["votes"]
    fixed = changed(base, WAITING)
    fixed = with_values(fixed, {"imu.window_s": (2.0, 20.0), "air.method": "bank"})
    pipeline = Pipeline(base)
    done = pipeline.retune(fixed)
    assert done.taken == ()
    assert set(done.waiting) == WAITING | {"imu.window_s", "air.method"}
    assert pipeline.settings == base
    assert same(fly(pipeline, flight), fly(Pipeline(base), flight))


@given(data=st.data())
@effort(deadline=None, max_examples=25)
def test_any_keys_at_any_time_are_taken_or_wait_and_stay_valid(data: st.DataObject) -> None:
    base = data.draw(st.sampled_from([load(profile) for profile in PROFILES]))
    keys = keys_of(base)
    pipeline = Pipeline(base)
    for _ in range(2):
        some = data.draw(st.frozensets(st.sampled_from(keys), max_size=8))
        new = changed(base, some)
        before = pipeline.settings
        done = pipeline.retune(new)
        assert set(done.taken) | set(done.waiting) == set(differing(before, new))
        Settings.model_validate(pipeline.settings.model_dump())


def test_a_latched_fault_outlives_new_thresholds_and_a_lower_one_finds_more(flight: Batch) -> None:
    base = BASES["votes"]
    blunt = with_values(
        base,
        {
            "imu.difference_sigma": 1e6,
            "imu.single_sigma": 1e6,
            "triplex.cas_threshold_m_s": 100.0,
            "triplex.common_cas_m_s": 100.0,
        },
    )
    plain = {(v.sensor, v.t_us) for v in fly(Pipeline(base), flight).verdicts if faulty(v)}
    assert {"imu0.acc_x", "airspeed0"} <= {sensor for sensor, _ in plain}
    unseen = {v.sensor for v in fly(Pipeline(blunt), flight).verdicts if faulty(v)}
    assert unseen.isdisjoint({"imu0.acc_x", "airspeed0"})
    # the faults begin after 60 of 90 seconds: piece 20 of 30
    pipeline = Pipeline(base)
    late = fly(pipeline, flight, {24: blunt})
    assert plain <= {(v.sensor, v.t_us) for v in late.verdicts if faulty(v)}
    assert pipeline.states()["imu0.acc_x"].state is State.FAULTY
    pipeline = Pipeline(blunt)
    fly(pipeline, flight, {22: base})
    assert pipeline.states()["airspeed0"].state is State.FAULTY
    assert pipeline.states()["imu0.acc_y"].state is State.OK


def faulty(verdict: Any) -> bool:
    return bool(verdict.state is State.FAULTY)


def test_time_outs_change_for_streams_that_are_there(flight: Batch) -> None:
    base = Settings()
    pipeline = Pipeline(base)
    pipeline.feed(flight)
    assert pipeline.retune(with_values(base, {"streams.imu_timeout_s": 7.0})).taken == (
        "streams.imu_timeout_s",
    )
    assert pipeline.streams["imu0"].timeout_us == 7_000_000
    assert pipeline.streams["gps0"].timeout_us == 3_000_000


def test_sections_of_others_are_not_looked_at() -> None:
    base = Settings()
    new = changed(base, ["web.rate_hz", "publish.mask_rate_hz", "recorder.file_max_mb"])
    assert Pipeline(base).retune(new) == Retuned()


# ---------------------------------------------------------------------------- the publisher


def heartbeats_and_masks(publisher: Publisher, begin_us: int, seconds: float) -> int:
    publisher.note(StepResult())
    count = 0
    for now_us in range(begin_us, begin_us + round(seconds * 1e6), 10_000):
        count += sum(m.name == "NAMED_VALUE_FLOAT" for m in publisher.due(now_us, 0, False))
    return count


def test_the_publisher_takes_new_rates_at_once() -> None:
    from monitor.verdict import Verdict

    base = Settings()
    publisher = Publisher(base.publish)
    publisher.note(StepResult([Verdict(0, "airspeed0", State.OK)]))
    assert heartbeats_and_masks(publisher, 0, 10.0) == 40  # FLT_AIR and MON_AIR, twice a second
    new = with_values(base, {"publish.mask_rate_hz": 10.0, "publish.to_input": False})
    assert publisher.retune(new) == Retuned(("publish.mask_rate_hz",), ("publish.to_input",))
    assert heartbeats_and_masks(publisher, 10_000_000, 10.0) == pytest.approx(200, abs=2)
    assert publisher.retune(base).taken == ("publish.mask_rate_hz",)
    assert heartbeats_and_masks(publisher, 20_000_000, 10.0) == pytest.approx(40, abs=2)


# ---------------------------------------------------------------------------- helpers' own test


def test_values_that_are_tried_are_valid() -> None:
    for profile in PROFILES:
        base = load(profile)
        for key in keys_of(base):
            try:
                Settings.model_validate(changed(base, [key]).model_dump())
            except ValidationError as error:
                # values that a validator relates are fixed together, so neither is taken
                assert key in WAITING | {"engine.two_spool.sample_s"}, error  # noqa: PT017
