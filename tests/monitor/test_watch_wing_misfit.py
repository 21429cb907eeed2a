"""An airframe that is not this aircraft's: the wings are not judged, and the reason says so."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from estimators.wing_model import AERODYNAMIC
from links.airframes import load_airframe
from links.logs import open_log
from links.samples import Batch
from links.vocabulary import Reason, State
from monitor.pipeline import Pipeline
from monitor.settings import Settings
from monitor.verdict import Verdict
from monitor.watch.wing import WingWatch
from sim_feeds.papers.samar2006 import wrong_numbers
from tests.monitor.test_watch_wing import ONSET_S, SENSORS, faults, rows, run, settings

TRUE = load_airframe("aerosonde")
SITL = Path(__file__).parents[3] / "shared" / "data" / "sitl" / "n1_calm_nominal.tlog"


def written(path: Path, numbers: dict[str, float]) -> str:
    path.write_text("[all]\n" + "\n".join(f"{k} = {float(v)!r}" for k, v in numbers.items()))
    return str(path)


@pytest.fixture
def heavy(tmp_path: Path) -> str:
    """Coefficients of an aircraft of twice the mass."""
    return written(tmp_path / "heavy.toml", TRUE | {"mass_kg": 2.0 * TRUE["mass_kg"]})


def test_another_aircraft_is_not_judged(heavy: str) -> None:
    result = run(rows("healthy"), settings(heavy))
    assert not faults(result)
    assert not [v for v in result.verdicts if v.state is State.OK]
    last = {v.sensor: v for v in result.verdicts}
    assert {s: v.reason for s, v in last.items()} == dict.fromkeys(SENSORS, Reason.AIRFRAME_MISFIT)
    evidence = last["wing_left.lift"].evidence
    assert "mavsentry learn airframe" in evidence
    assert "surfaces" in evidence


def test_nor_is_its_damage(heavy: str) -> None:
    assert not faults(run(rows("right-lift"), settings(heavy)))


def test_the_limit_is_a_setting(heavy: str) -> None:
    result = run(rows("healthy"), settings(heavy, misfit_limit=1000.0))
    assert Reason.AIRFRAME_MISFIT not in {v.reason for v in result.verdicts}


@pytest.mark.parametrize("model", [301, 306])
def test_coefficients_that_are_somewhat_off_are_judged(model: int, tmp_path: Path) -> None:
    numbers = wrong_numbers(TRUE, AERODYNAMIC, model)
    path = written(tmp_path / "off.toml", numbers)
    healthy = run(rows("healthy"), settings(path))
    assert {v.sensor for v in healthy.verdicts if v.state is State.OK} == SENSORS
    assert Reason.AIRFRAME_MISFIT not in {v.reason for v in healthy.verdicts}
    lift = [v for v in faults(run(rows("right-lift"), settings(path))) if "lift" in v.sensor]
    assert {v.sensor for v in lift} == {"wing_right.lift"}
    assert 0.0 < lift[0].t_us * 1e-6 - ONSET_S < 8.0


def test_where_the_stream_is_cut_changes_nothing(heavy: str) -> None:
    given = rows("healthy")
    phase = given.pop("phase")
    count = sum(len(r) for r in given.values())
    cuts = np.sort(np.random.default_rng(4).choice(count, 40, replace=False))
    watch = WingWatch(settings(heavy))
    said: list[Verdict] = []
    for k, piece in enumerate(Batch(given).split(cuts.tolist())):
        until_us = max((int(r["t_us"][-1]) for r in piece.rows.values()), default=0) + 1
        extra = {"phase": phase} if k == 0 else {}
        said += watch.step({**piece.rows, **extra}, until_us).verdicts
    assert repr(said) == repr(run({**given, "phase": phase}, settings(heavy)).verdicts)


@pytest.mark.skipif(not SITL.exists(), reason="needs the shared SITL flights")
def test_a_plane_of_sitl_is_no_aerosonde() -> None:
    chosen = Settings(wing=settings())
    pipeline = Pipeline(chosen, watches=[WingWatch(chosen.wing)])
    verdicts: list[Verdict] = []
    for batch in open_log(SITL, chosen.links.decoder_options()):
        verdicts += pipeline.feed(batch).verdicts
    verdicts += pipeline.finish().verdicts
    wing = [v for v in verdicts if v.sensor in SENSORS]
    assert not [v for v in wing if v.state is State.FAULTY]
    assert {v.sensor for v in wing if v.reason is Reason.AIRFRAME_MISFIT} == SENSORS
