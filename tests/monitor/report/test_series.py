"""Thinning keeps every peak and breaks lines where there is nothing; spans have no gaps."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from links.vocabulary import Kind, Reason, State
from monitor.report import spans as spans_module
from monitor.report.series import firsts, thinned, track_of, wrapped
from monitor.report.spans import BEFORE, NOT_LISTED, spans_of
from monitor.verdict import Verdict


def rows(n: int, seed: int, span_us: int = 10**7) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    t_us = np.sort(rng.choice(span_us, n, replace=False))
    low = rng.normal(0.0, 1.0, n)
    high = low + rng.exponential(1.0, n)
    unknown = rng.random(n) < 0.1
    low[unknown] = high[unknown] = np.nan
    return t_us, low, high


@settings(max_examples=80, deadline=None)
@given(
    n=st.integers(1, 400),
    points=st.integers(1, 50),
    cuts=st.lists(st.integers(0, 400), max_size=5),
    span=st.tuples(st.integers(0, 10**7), st.integers(0, 10**7)),
    seed=st.integers(0, 10**6),
)
def test_no_peak_is_lost_and_no_value_is_made_up(
    n: int, points: int, cuts: list[int], span: tuple[int, int], seed: int
) -> None:
    from_us, to_us = min(span), max(span)
    t_us, low, high = rows(n, seed)
    edges = sorted({0, n, *(min(cut, n) for cut in cuts)})
    pieces = [(t_us[a:b], low[a:b], high[a:b]) for a, b in itertools.pairwise(edges)]
    found = thinned(pieces, from_us, to_us, points, 10**9)
    inside = (t_us >= from_us) & (t_us <= to_us)
    if not inside.any():
        assert found is None
        return
    assert found is not None
    t, least, greatest = found
    assert len(t) <= points
    assert (np.diff(t) > 0).all()
    assert ((t >= from_us) & (t <= to_us)).all()
    if np.isfinite(low[inside]).any():
        assert np.nanmin(least) == np.nanmin(low[inside])
        assert np.nanmax(greatest) == np.nanmax(high[inside])
    # what stands at a point are extremes of rows that were measured about then
    width_us = (to_us - from_us + 1) / points
    for at, a, b in zip(t, least, greatest, strict=True):
        near = inside & (np.abs(t_us - at) <= width_us)
        assert np.isnan(a) or a in low[near]
        assert np.isnan(b) or b in high[near]
    at_once = thinned([(t_us, low, high)], from_us, to_us, points, 10**9)
    assert at_once is not None
    for whole, part in zip(at_once, found, strict=True):
        np.testing.assert_array_equal(whole, part)


def test_few_rows_stay_as_they_are() -> None:
    t_us, low, high = rows(40, 1)
    found = thinned([(t_us, low, high)], 0, 10**7, 40, 10**9)
    assert found is not None
    for mine, theirs in zip(found, (t_us, low, high), strict=True):
        np.testing.assert_array_equal(mine, theirs)


@pytest.mark.parametrize("points", [1000, 30])
def test_a_gap_breaks_the_line_once_and_a_boot_is_one(points: int) -> None:
    """Rows at 10 Hz, a pause of 7 s, and a second after which the vehicle booted anew."""
    t_us = np.concatenate([np.arange(0, 20, 0.1), np.arange(27, 40, 0.1), np.arange(41.2, 60, 0.1)])
    t_us = (t_us * 1e6).astype(np.int64)
    values = np.ones(len(t_us))
    found = thinned([(t_us, values, values)], 0, 60_000_000, points, 1_000_000)
    assert found is not None
    broken = found[0][np.isnan(found[1])] / 1e6
    np.testing.assert_allclose(broken, [23.5, 40.55], atol=0.1)


def test_a_direction_that_passes_north_makes_no_stroke() -> None:
    t_s = np.arange(6.0)
    direction = np.radians([340.0, 350.0, 1.0, 10.0, 355.0, 350.0])
    t, values = wrapped(t_s, direction)
    np.testing.assert_array_equal(t, [0.0, 1.0, 1.5, 2.0, 3.0, 3.5, 4.0, 5.0])
    assert np.isnan(values).tolist() == [False, False, True, False, False, True, False, False]


def test_a_place_is_the_first_of_its_time_and_a_metre_is_a_metre() -> None:
    t_us = np.arange(0, 100_000_000, 200_000)
    north_m, east_m = 20.0 * t_us / 1e6, -5.0 * t_us / 1e6
    # one degree of latitude at 45 deg is 111132 m long, one of longitude 78847 m (WGS 84)
    lat = np.radians(45.0 + north_m / 111_132.0)
    lon = np.radians(179.99 - east_m / 78_847.0)
    lon = (lon + np.pi) % (2.0 * np.pi) - np.pi  # over the date line
    track = track_of([(t_us, lat, lon)], 0, 100_000_000, 50, 3_000_000, "gps0")
    assert track is not None
    assert len(track.t_s) == 50
    np.testing.assert_allclose(track.north_m, 20.0 * track.t_s, rtol=2e-3, atol=0.1)
    np.testing.assert_allclose(track.east_m, 5.0 * track.t_s, rtol=2e-3, atol=0.1)
    assert track_of([(t_us, lat * np.nan, lon)], 0, 10**8, 50, 10**6, "gps0") is None


def test_first_rows_do_not_depend_on_the_pieces() -> None:
    t_us, a, b = rows(300, 5)
    pieces = [(t_us[k : k + 7], a[k : k + 7], b[k : k + 7]) for k in range(0, 300, 7)]
    whole = next(firsts([(t_us, a, b)], 0, 10**7, 40))
    parts = [np.concatenate(c) for c in zip(*firsts(pieces, 0, 10**7, 40), strict=True)]
    for mine, theirs in zip(parts, whole, strict=True):
        np.testing.assert_array_equal(mine, theirs)
    assert len(whole[0]) <= 40


# ---------------------------------------------------------------------------------- spans


def said(t_s: float, state: State, reason: Reason | None = None, **more: object) -> Verdict:
    return Verdict(round(t_s * 1e6) + 500, "airspeed0", state, reason, **more)  # type: ignore[arg-type]


def test_spans_cover_the_log_from_its_first_record_to_its_last() -> None:
    verdicts = [
        said(2.0, State.UNMONITORED, Reason.ON_GROUND),
        said(10.0, State.OK),
        said(12.0, State.OK),
        said(20.0, State.FAULTY, kind=Kind.BIAS, evidence="reads high"),
        said(30.0, State.STALE, evidence="sends no data any more"),
        said(31.0, State.FAULTY, kind=Kind.BIAS, evidence="reads high"),
        said(99.0, State.OK),
    ]
    (spans,) = spans_of(verdicts, 500, 60.0).values()
    assert [(s.from_s, s.to_s, str(s.state), s.reason, s.kind) for s in spans] == [
        (0.0, 2.0, "unmonitored", BEFORE, None),
        (2.0, 10.0, "unmonitored", "on ground", None),
        (10.0, 20.0, "ok", None, None),
        (20.0, 30.0, "faulty", None, "bias"),
        (30.0, 31.0, "stale", None, None),
        (31.0, 60.0, "faulty", None, "bias"),
    ]
    assert spans[3].evidence == "reads high"


def test_what_was_not_kept_is_not_known(monkeypatch: pytest.MonkeyPatch) -> None:
    verdicts = [said(k, (State.OK, State.SUSPECT)[k % 2]) for k in range(40)]
    (spans,) = spans_of(verdicts, 500, 60.0, left_out=7).values()
    assert spans[-1] == (39.0, 60.0, State.UNMONITORED, NOT_LISTED, None, "")
    monkeypatch.setattr(spans_module, "LISTED", 10)
    (spans,) = spans_of(verdicts, 500, 60.0).values()
    assert len(spans) == 10
    assert spans[-1] == (9.0, 60.0, State.UNMONITORED, NOT_LISTED, None, "")
    assert [s.to_s for s in spans[:-1]] == [s.from_s for s in spans[1:]]


def test_a_verdict_behind_the_last_one_makes_no_span_of_negative_length() -> None:
    verdicts = [said(5.0, State.OK), said(4.0, State.SUSPECT), said(6.0, State.OK)]
    (spans,) = spans_of(verdicts, 500, 10.0).values()
    assert all(s.to_s >= s.from_s for s in spans)
    assert [(s.from_s, s.to_s) for s in spans] == [(0.0, 5.0), (5.0, 6.0), (6.0, 10.0)]
