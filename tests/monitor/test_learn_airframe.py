"""Coefficients that are wrong, refined from healthy flights, and what the file says."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from estimators.wing_fit import UNSEEN
from estimators.wing_model import AERODYNAMIC
from links.airframes import load_airframe
from links.samples import Batch
from monitor.cli import app
from monitor.commands.common import Refused
from monitor.commands.learn import _show_airframe
from monitor.learn.airframe import (
    AirframeFlight,
    AirframeLearnt,
    airframe_document,
    airframe_flight_of,
    doubt,
    learn_airframe,
)
from monitor.learn.fit import Unfit
from monitor.settings import Settings
from monitor.settings.wing import WingSettings, airframe_of
from sim_feeds.papers.samar2006 import wrong_numbers
from sim_feeds.sixdof import fly_aerosonde
from tests.monitor.test_watch_wing import settings
from tests.monitor.wing_flights import rows_of

pytest.importorskip("jsbsim", reason="the vehicle needs the extra sim")

TRUE = load_airframe("aerosonde")
MODEL = 401


@cache
def batch(seed: int) -> Batch:
    return rows_of(fly_aerosonde(seed=seed, wind_share=0.22, duration_s=200.0), seed=seed)


@pytest.fixture(scope="module")
def wrong(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    path = tmp_path_factory.mktemp("airframe") / "wrong.toml"
    numbers = wrong_numbers(TRUE, AERODYNAMIC, MODEL)
    path.write_text("[all]\n" + "\n".join(f"{k} = {float(v)!r}" for k, v in numbers.items()))
    return Settings(wing=settings(str(path)))


@pytest.fixture(scope="module")
def flights(wrong: Settings) -> list[AirframeFlight]:
    return [airframe_flight_of([batch(seed)], wrong, f"{seed}.tlog") for seed in (81, 82)]


@pytest.fixture(scope="module")
def learnt(wrong: Settings, flights: list[AirframeFlight]) -> AirframeLearnt:
    return learn_airframe(flights, wrong)


def test_what_flights_can_tell_comes_closer(learnt: AirframeLearnt) -> None:
    fit = learnt.fit
    assert {"CL0", "CLalpha", "CT0"} <= set(fit.identified)
    off = [abs(getattr(fit.airframe, n) / TRUE[n] - 1.0) for n in fit.identified]
    assert np.median(off) < 0.15  # what it was for all
    assert abs(fit.airframe.CT0 / TRUE["CT0"] - 1.0) < 0.05
    assert fit.scatter[1] < 0.5 * fit.scatter[0]


def test_what_they_cannot_keeps_its_value(learnt: AirframeLearnt) -> None:
    fit, start = learnt.fit, learnt.start.airframe
    assert set(UNSEEN) <= set(fit.kept)
    assert set(fit.kept) | set(fit.identified) == set(AERODYNAMIC)
    for name in fit.kept:
        assert getattr(fit.airframe, name) == getattr(start, name)


def test_the_file_is_read_back(learnt: AirframeLearnt, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(airframe_document(learnt, "mine"))
    known = airframe_of(WingSettings(airframe=str(path)))
    assert known.airframe.CT0 == pytest.approx(learnt.fit.airframe.CT0, rel=1e-5)
    assert known.airframe.mass_kg == TRUE["mass_kg"]
    np.testing.assert_allclose(known.std, learnt.fit.std, rtol=0.01)
    assert known.learnt_percent == pytest.approx(learnt.healthy_percent, rel=0.01)
    assert (known.travel_us, known.travel_deg) == (400.0, 28.648)
    assert tomllib.loads(path.read_text())["name"] == "mine"


def test_travels_that_the_settings_name_go_into_the_file(learnt: AirframeLearnt) -> None:
    own = airframe_document(replace(learnt, travel=((350.0, 20.0),) * 3), "mine")
    assert tomllib.loads(own)["surfaces"] == {"travel_us": 350.0, "travel_deg": 20.0}
    apart = ((400.0, 20.0), (400.0, 25.0), (400.0, 25.0))
    assert not tomllib.loads(airframe_document(replace(learnt, travel=apart), "m"))["surfaces"]


def test_an_airframe_that_fits_raises_no_doubt(learnt: AirframeLearnt) -> None:
    assert doubt(learnt) == ""
    assert learnt.unlike < 0.5
    assert "WARNING" not in airframe_document(learnt, "mine")


def test_residuals_that_stay_large_are_told(
    flights: list[AirframeFlight], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "heavy.toml"
    numbers = TRUE | {"mass_kg": 3.0 * TRUE["mass_kg"]}
    path.write_text("[all]\n" + "\n".join(f"{k} = {float(v)!r}" for k, v in numbers.items()))
    other = learn_airframe(flights, Settings(wing=settings(str(path))))
    text = airframe_document(other, "other")
    assert "# WARNING: this airframe does not fit these flights: residuals stay at" in text
    assert "would not judge" in " ".join(text.replace("# ", "").split())
    assert tomllib.loads(text)["name"] == "other"
    _show_airframe(other, tmp_path / "other.toml")
    assert "warning: this airframe does not fit these flights" in capsys.readouterr().out


def test_a_log_without_servos_is_refused(wrong: Settings) -> None:
    rows = {name: r for name, r in batch(81).rows.items() if name != "servo"}
    with pytest.raises(Unfit, match=r"x\.tlog: flies 0 s .* servo outputs is missing"):
        airframe_flight_of([Batch(rows)], wrong, "x.tlog")


@pytest.mark.parametrize("step_s", [0.05, 30.0])
def test_flights_of_moments_only_are_refused(
    wrong: Settings, flights: list[AirframeFlight], step_s: float
) -> None:
    """Too short for one row, or with a pause before every moment."""
    one, t_s = flights[0], step_s * np.arange(5)
    short = AirframeFlight("a.tlog", t_s, one.x[:5], one.acc[:5])
    with pytest.raises(Unfit, match="no stretch with all inputs"):
        learn_airframe([short, short], wrong)


def test_the_command_names_a_missing_coefficient(tmp_path: Path) -> None:
    start, log = tmp_path / "start.toml", tmp_path / "a.tlog"
    start.write_text("[all]\nmass_kg = 11.0\n")
    log.write_bytes(b"")
    result = CliRunner().invoke(
        app,
        ["learn", "airframe", str(log), "--start", str(start), "--out", str(tmp_path / "o.toml")],
    )
    assert isinstance(result.exception, Refused)
    assert "lacks Jx_kg_m2" in str(result.exception)
