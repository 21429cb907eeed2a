"""Flights as a report sees them: one of a synthetic feed, and those recorded, each read once."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from monitor.commands.feed import write_log
from monitor.report.flight import Flight
from sim_feeds.scenario import load
from tests.monitor.report.analysed import SCENARIO, analysed


@pytest.fixture(scope="session")
def synthetic_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Telemetry log of three minutes: 50 Hz IMUs, a pitot 40 % low at 70 s, acc_x off at 120 s."""
    folder = tmp_path_factory.mktemp("synthetic")
    (folder / "flight.toml").write_text(SCENARIO)
    write_log(load(folder / "flight.toml").fly(), folder / "flight.tlog")
    return folder / "flight.tlog"


@pytest.fixture(scope="session")
def flight(synthetic_log: Path) -> Flight:
    """The synthetic flight, analysed."""
    return analysed(synthetic_log)


@pytest.fixture(scope="session")
def recorded(shared_data: Path) -> Callable[[str], Flight]:
    """Analyses a log of the shared data once: ``recorded("sitl/f5_gyro_bias.tlog")``."""

    @cache
    def flight_of(name: str) -> Flight:
        if not (shared_data / name).is_file():
            pytest.skip(f"no {name} in the shared data")
        return analysed(shared_data / name)

    return flight_of
