"""Streams on the wing watch's grid: pauses, trims, and a throttle that is not there."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from links.samples import Batch, Rows, empty_rows
from monitor.settings.wing import WingSettings
from monitor.warmup import numbered
from monitor.watch.wing_inputs import GAP_S, NEEDED, Ticks, WingInputs
from tests.monitor.wing_flights import RATES_HZ

TICK_S = 0.05
PROPELLER = NEEDED.index("propeller speed")


def streams(duration_s: float = 20.0, pause_s: float = 0.0) -> dict[str, Rows]:
    """Level flight north; halfway, all streams pause."""
    rows = {}
    for name, rate_hz in RATES_HZ.items():
        one = rows[name] = empty_rows(name, int(duration_s * rate_hz))
        one["t_us"] = np.round((np.arange(len(one)) + 0.3) * 1e6 / rate_hz)
        one["t_us"][one["t_us"] > 0.5e6 * duration_s] += round(pause_s * 1e6)
    rows["attitude"]["q_ned_from_frd"] = [1.0, 0.0, 0.0, 0.0]
    rows["nav"]["vel_ned_m_s"] = [25.0, 0.0, 0.0]
    rows["imu0"]["acc_m_s2"] = [0.0, 0.0, -9.8]
    rows["airspeed0"]["cas_m_s"] = 25.0
    rows["baro0"]["static_press_pa"] = 101325.0
    rows["servo"]["pwm_us"] = 1500.0
    rows["spool0"]["speed_rpm"] = 4500.0
    return numbered(rows)


def taken(rows: dict[str, Rows], cuts: list[int] | None = None, **other: object) -> Ticks:
    inputs = WingInputs(WingSettings.model_validate(other))
    parts = [inputs.take(piece.rows, 0) for piece in Batch(rows).split(cuts or [])]
    return Ticks(*(np.concatenate([getattr(p, n) for p in parts]) for n in Ticks.__slots__))


def trim(t_s: float, value: float) -> Rows:
    row = empty_rows("param", 1)
    row["t_us"], row["name"], row["value"] = round(t_s * 1e6), b"SERVO1_TRIM", value
    return row


def test_a_long_pause_has_few_ticks() -> None:
    before, after = taken(streams()), taken(streams(pause_s=4e6))
    assert len(after.t_s) <= len(before.t_s) + (GAP_S + 0.1) / TICK_S
    jump = np.flatnonzero(np.diff(after.t_s) > 1.5 * TICK_S)
    assert len(jump) == 1
    assert after.t_s[jump[0]] == pytest.approx(10.0 + GAP_S, abs=0.1)
    assert (after.lacks[after.t_s > 4e6 + 10.5] == -1).all()
    blank = (after.t_s > 10.1) & (after.t_s < 4e6)
    assert (after.lacks[blank] >= 0).all()


def test_a_pause_of_six_seconds_is_skipped_in_part() -> None:
    gaps = np.diff(taken(streams(pause_s=6.0)).t_s)
    assert 0.5 < gaps.max() < 1.2
    assert np.diff(taken(streams(pause_s=GAP_S - 0.1)).t_s).max() < 1.5 * TICK_S


@pytest.mark.parametrize("pause_s", [0.0, 5.5, 700.0])
def test_where_the_stream_is_cut_changes_nothing(pause_s: float) -> None:
    rows = streams(pause_s=pause_s)
    count = sum(len(r) for r in rows.values())
    whole = taken(rows)
    for first, step in itertools.product((1, 4), (7, 150)):
        pieces = taken(rows, list(range(first, count, step)))
        for name in Ticks.__slots__:
            assert np.array_equal(getattr(pieces, name), getattr(whole, name), equal_nan=True), name


def test_a_throttle_that_was_never_heard_is_not_idle() -> None:
    rows = streams()
    rows["servo"]["pwm_us"][:, 2] = 0.0
    assert (taken(rows).lacks[20:] == -1).all()  # from the engine speed
    assert (taken(rows, thrust_from="rpm").lacks[20:] == -1).all()
    assert (taken(rows, thrust_from="throttle").lacks[20:] == PROPELLER).all()
    del rows["spool0"]
    assert (taken(rows).lacks[20:] == PROPELLER).all()
    rows["servo"]["pwm_us"][:, 2] = 1500.0
    assert (taken(rows).lacks[20:] == -1).all()


@pytest.mark.parametrize("value", [np.nan, 0.0, -1.0, np.inf, 2.0e4])
def test_a_trim_that_is_no_pulse_is_passed_over(value: float) -> None:
    rows = streams()
    plain = taken(rows)
    for heard, expected in (([], 0.0), ([trim(1.0, 1600.0)], -0.25)):
        told = np.concatenate([*heard, trim(2.0, value)])
        ticks = taken(rows | {"param": told})
        np.testing.assert_array_equal(ticks.lacks, plain.lacks)
        aileron = ticks.x[ticks.t_s > 3.0, 10] / np.radians(25.0)
        np.testing.assert_allclose(aileron, expected, atol=1e-12)
