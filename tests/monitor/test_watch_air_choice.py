"""The choice between bank and vote, and what becomes of a vane beside the bank."""

import itertools

import numpy as np
import pytest

from links.samples import empty_rows
from links.vocabulary import Reason, State
from monitor.settings import Settings
from monitor.verdict import PHASE_ROW, Verdict
from monitor.watch.air import AirWatch

from .air_flights import TAKE_OFF_S, Flight, circuits, numbered

LANDING_S = 30.0


def flight(pitots: int, vane_from_s: float = 0.0) -> Flight:
    """Forty seconds with one vane of 10 Hz; the last ten after landing."""
    out = circuits(40.0, pitots=pitots)
    t = np.arange(vane_from_s, 40.0, 0.1)
    vane = out["aoa0"] = empty_rows("aoa0", len(t))
    vane["t_us"] = t * 1e6
    vane["aoa_rad"] = 0.05 + 0.002 * np.random.default_rng(0).standard_normal(len(t))
    phase = out["phase"] = np.zeros(2, PHASE_ROW)
    phase["t_us"] = np.array([TAKE_OFF_S, LANDING_S]) * 1e6
    phase["flying"] = True, False
    return numbered(out)


def judged(rows: Flight, cuts_s: tuple[float, ...] = ()) -> list[Verdict]:
    settings = Settings()
    watch = AirWatch(settings.air, settings.triplex)
    verdicts: list[Verdict] = []
    for low, high in itertools.pairwise([-1, *(int(s * 1e6) for s in cuts_s), 1 << 60]):
        part = {s: r[(r["t_us"] >= low) & (r["t_us"] < high)] for s, r in rows.items()}
        verdicts += watch.step(part, high).verdicts
    return verdicts


@pytest.mark.parametrize("pitots", [1, 2])
def test_a_vane_beside_the_bank_is_learnt_in_flight(pitots: int) -> None:
    mine = [v for v in judged(flight(pitots)) if v.sensor == "aoa0"]
    assert {v.state for v in mine} == {State.UNMONITORED}
    assert [v.reason for v in mine] == [Reason.ON_GROUND, Reason.LEARNING, Reason.ON_GROUND]
    assert [v.t_us for v in mine[1:]] == [TAKE_OFF_S * 1e6, LANDING_S * 1e6]


def test_a_vane_that_appears_in_flight_is_learnt_from_its_first_sample() -> None:
    mine = [v for v in judged(flight(1, vane_from_s=12.0)) if v.sensor == "aoa0"]
    assert [(v.reason, v.t_us) for v in mine] == [
        (Reason.LEARNING, 12e6),
        (Reason.ON_GROUND, LANDING_S * 1e6),
    ]


@pytest.mark.parametrize("cuts_s", [(4.95, 5.0, 5.05), (2.0, 29.0, 30.0), tuple(range(1, 40))])
def test_the_words_are_the_same_however_the_stream_is_cut(cuts_s: tuple[float, ...]) -> None:
    rows = flight(2)
    assert repr(judged(rows, cuts_s)) == repr(judged(rows))
