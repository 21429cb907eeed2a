"""What the reproduction of lu2016 flies: the file, the flights, the recordings."""

import numpy as np
import pytest

from sim_feeds.papers.lu2016 import lu2016_experiment, lu2016_plan
from sim_feeds.papers.lu2016_flights import Recording, record, section_of
from sim_feeds.papers.lu2016_runs import runs

NAMES = ("level", "parabolic", "turbulent")


@pytest.fixture(scope="module")
def recordings() -> dict[str, Recording]:
    return {name: record(name, 3) for name in NAMES}


def test_nothing_is_tuned_on_what_is_reported() -> None:
    r = runs()
    reported = {*r.simulated.seeds, *r.rates.seeds, *r.fault_walk.seeds, *r.open_loop.seeds}
    assert reported.isdisjoint(r.simulated.tuning_seeds)
    for section in (r.simulated, r.rates, r.fault_walk, r.open_loop):
        assert set(section.chosen(quick=True)) <= set(section.chosen(quick=False))


def test_the_flights_are_the_three_of_section_4() -> None:
    assert tuple(f.name for f in runs().flight) == NAMES
    with pytest.raises(KeyError):
        section_of("inverted")


def test_the_parabolic_flight_is_weightless_between_pulls(
    recordings: dict[str, Recording],
) -> None:
    truth = recordings["parabolic"].truth
    az, t = truth.specific_force_m_s2[:, 2], truth.t_s
    assert az.min() < -18.0  # Fig. 7(b): almost -20 m/s^2 at 16 s
    assert np.abs(az[(t > 20.5) & (t < 25.0)]).max() < 1.0
    assert truth.aoa_rad.min() < 0.0


def test_the_turbulent_flight_begins_smoothly(recordings: dict[str, Recording]) -> None:
    truth = recordings["turbulent"].truth
    az, t = truth.specific_force_m_s2[:, 2], truth.t_s
    assert az[t < 9.9].std() < 0.01
    assert az[t > 15.0].std() > 0.3


def test_the_level_flight_is_steady(recordings: dict[str, Recording]) -> None:
    truth = recordings["level"].truth
    assert np.ptp(truth.height_m) < 1.0
    assert np.abs(truth.euler_rad[:, 0]).max() < 0.01


@pytest.mark.parametrize("name", NAMES)
def test_the_ground_speed_is_that_of_the_receiver_joined_by_lines(
    recordings: dict[str, Recording], name: str
) -> None:
    r = recordings[name]
    came = np.isfinite(r.y_sparse[:, 0])
    assert np.count_nonzero(came) == r.flight.t_s[-1] + 1
    assert np.array_equal(r.y_sparse[came], r.flight.y_ground[came])
    assert np.array_equal(r.y_sparse[:, 3:], r.flight.y_ground[:, 3:])
    bend = np.diff(r.flight.y_ground[:, 0], 2)[~came[1:-1]]
    assert np.abs(bend).max() < 1e-9
    error = r.y_sparse[came, :3] - r.flight.x_ground[came, :3]
    assert 0.015 < error.std() < 0.045


def test_faults_are_written_into_the_same_recording(recordings: dict[str, Recording]) -> None:
    broken, clean = recordings["level"].flight, record("level", 3, faults=[]).flight
    assert np.allclose(broken.u_m - broken.f, clean.u_m, rtol=0, atol=1e-12)
    assert np.array_equal(broken.y_air, clean.y_air)
    t = broken.t_s
    assert np.all(broken.f[(t < 10.0) | (t >= 30.0)] == 0.0)
    assert broken.f[2000, 0] == pytest.approx(3.0)


def test_the_same_seed_is_the_same_recording_and_another_is_not() -> None:
    one, same, other = (record("turbulent", seed).flight for seed in (1, 1, 2))
    assert np.array_equal(one.u_m, same.u_m)
    assert not np.allclose(one.u_m, other.u_m)


def test_another_plan_in_place_of_the_papers_flight() -> None:
    north = lu2016_experiment("calm", 0, plan=lu2016_plan(heading_rad=0.0))
    assert np.abs(north.x_ground[:, 1]).max() < 0.05
    assert np.abs(north.x_ground[:, 3]).max() < 1e-3
