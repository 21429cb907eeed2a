"""Peaks of the long horizon: a margin above them is not exceeded, and one below is."""

import numpy as np
import pytest

from links.vocabulary import State
from monitor.settings.air import AirSettings
from monitor.settings.horizon import HorizonSettings
from monitor.watch.air_bank import AirBankWatch

from .air_flights import Flight, circuits, judged

OUT_OF_REACH = 1e3


def leaking(pitots: int) -> Flight:
    """The first pitot reads ever less from 150 s on, by 4 % a minute."""
    flight = circuits(400.0, gust=0.5, pitots=pitots, weathercock=True)
    rows = flight["airspeed0"]
    since = np.clip(rows["t_us"] * 1e-6 - 150.0, 0.0, None)
    rows["cas_m_s"] *= 1.0 - 0.04 / 60.0 * since
    return flight


def watch(**margins: float) -> AirBankWatch:
    """Only the long horizon may accuse, by the margins given."""
    unreached = {"margin_one": OUT_OF_REACH, "margin_all": OUT_OF_REACH}
    horizon = HorizonSettings(**unreached | margins)
    return AirBankWatch(AirSettings(**unreached, horizon=horizon))


@pytest.mark.parametrize(("pitots", "key"), [(1, "margin_all"), (2, "margin_one")])
def test_a_margin_above_the_peak_is_not_exceeded_and_one_below_is(pitots: int, key: str) -> None:
    flight = leaking(pitots)

    def blamed(by: AirBankWatch) -> set[str]:
        return {v.sensor for v in judged(flight, by) if v.state is State.FAULTY}

    blind = watch()
    assert blamed(blind) == set()
    peak = blind.peaks()[f"air.horizon.{key}"]
    assert peak > 20.0
    assert blamed(watch(**{key: 1.001 * peak})) == set()
    assert blamed(watch(**{key: 0.8 * peak})) == {"airspeed0"}
