"""The sliding-mode observer: its equations, what it reconstructs, and the noise it pays with."""

import math

import numpy as np
import pytest

from estimators.baselines import numpy_twins_imu as twins
from estimators.baselines.sliding_mode import REACH, SlidingModeObserver, SlidingModeSettings
from estimators.kinematics import AS, GS
from sim_feeds.faults import Fault, FaultKind
from sim_feeds.papers.lu2016 import ImuExperiment, lu2016_experiment
from sim_feeds.papers.lu2016_runs import runs

SILENT = np.zeros(6)
TABLE_1_VELOCITY = 0.01
LAT, ALT = math.radians(52.0), 1000.0


@pytest.fixture(scope="module")
def silent() -> ImuExperiment:
    """Table 2's faults on a flight without any noise."""
    return lu2016_experiment("calm", 0, u_std=SILENT, ground_std=SILENT, air_std=SILENT)


@pytest.fixture(scope="module")
def healthy() -> ImuExperiment:
    return lu2016_experiment("calm", 1, faults=[])


def measured(flight: ImuExperiment, model: int) -> tuple[np.ndarray, np.ndarray]:
    """True initial state, measurements."""
    return (flight.x_ground[0], flight.y_ground) if model == GS else (flight.x_air[0], flight.y_air)


def followed(flight: ImuExperiment, model: int = GS, **changes: object) -> np.ndarray:
    x, y = measured(flight, model)
    settings = SlidingModeSettings(model=model, **changes)  # type: ignore[arg-type]
    return SlidingModeObserver(settings, x).run(flight.u_m[:-1], y[1:], flight.env[:-1])


@pytest.mark.parametrize("model", [GS, AS])
def test_two_steps_written_out(healthy: ImuExperiment, model: int) -> None:
    x, y = measured(healthy, model)
    settings = SlidingModeSettings(model=model)
    rho = np.array(REACH[model])
    delta = rho * settings.dt_s / settings.slope
    low = np.zeros(6)
    track = followed(healthy, model)
    for k in range(2):
        earth = twins.earth_terms(*healthy.env[k])
        moved = twins.rk4(model, x, healthy.u_m[k], earth, 0.01)
        z = y[k + 1].copy()
        if model == AS:
            V, alpha, beta = z[:3]
            flow = (
                math.cos(alpha) * math.cos(beta),
                math.sin(beta),
                math.sin(alpha) * math.cos(beta),
            )
            z[:3] = V * np.array(flow)
        e = z - moved
        nu = rho * e / (np.abs(e) + delta)
        x = moved + 0.01 * nu
        _, G = twins.linearise(model, x, healthy.u_m[k], earth)
        f = np.linalg.solve(G, nu)
        low = f + math.exp(-0.01 / settings.lowpass_s) * (low - f)
        assert np.allclose(track["x"][k], x, rtol=1e-12)
        assert np.allclose(track["f"][k], f, rtol=1e-8, atol=1e-9)
        assert np.allclose(track["f_low"][k], low, rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("model", [GS, AS])
def test_without_noise_it_follows_all_six_faults(silent: ImuExperiment, model: int) -> None:
    f = followed(silent, model)["f"]
    t = silent.t_s[1:]
    steady = ((t > 10.5) & (t < 30.0)) | (t > 30.5)
    error = np.abs(f - silent.f[1:])[steady].max(axis=0)
    # three samples late: an oscillation of 4 m/s^2 at 0.25 Hz moves by 0.2 m/s^2 in that time, and
    # a rate that is held over a sample while the aircraft rolls into its turn passes for a fault
    assert np.all(error < [0.02, 0.02, 0.2, 9e-4, 9e-4, 2e-4]), error


def test_the_noise_of_the_estimate_is_that_of_the_measurement_magnified(
    healthy: ImuExperiment,
) -> None:
    """For a small error the injection is linear: std(nu) = a / dt sqrt(2 / (2 - a)) sigma."""
    a = SlidingModeSettings().slope
    expected = a / 0.01 * math.sqrt(2.0 / (2.0 - a)) * TABLE_1_VELOCITY
    raw = followed(healthy)["f"][500:, :3].std(axis=0)
    # the smooth switch injects a little less, the IMU's own noise adds a little
    assert np.allclose(raw, expected, rtol=0.10)
    assert 0.6 < raw.mean() < 0.9


def test_an_overshooting_injection_chatters_about_the_fault(silent: ImuExperiment) -> None:
    """Beyond one sample's worth it switches sign at each sample; its mean is still the fault."""
    track = followed(silent, slope=1.95, lowpass_s=0.3)
    after = slice(1001, 1020)
    jumps = np.diff(track["f"][after, 0])
    assert np.all(jumps[1:] * jumps[:-1] < 0.0)
    assert abs(track["f_low"][2500, 0] - 3.0) < 0.02


def test_the_lowpass_is_the_best_of_its_neighbours_on_the_tuning_draws() -> None:
    def error(lowpass_s: float) -> float:
        logs = []
        for seed in runs().simulated.tuning_seeds:
            flight = lu2016_experiment("calm", seed)
            f = followed(flight, lowpass_s=lowpass_s)["f_low"]
            logs.append(np.log(np.mean((f - flight.f[1:]) ** 2, axis=0)).mean())
        return float(np.median(logs))

    chosen = SlidingModeSettings().lowpass_s
    assert error(chosen) < min(error(0.05), error(0.13))


def test_a_fault_beyond_its_reach_cannot_be_reconstructed() -> None:
    large = Fault("imu0.acc_x", FaultKind.BIAS, 5.0, size=8.0)
    flight = lu2016_experiment("calm", 0, faults=[large])
    for reach, found in ((5.0, False), (20.0, True)):
        track = followed(flight, reach=(reach,) * 3 + (0.5,) * 3)
        assert (abs(np.mean(track["f"][-500:, 0]) - 8.0) < 0.1) == found
        away = np.abs(track["x"][-1, :3] - flight.x_ground[-1, :3]).max()
        assert (away < 1.0) == found


def test_a_heading_that_crosses_south_is_no_fault() -> None:
    n, turn = 3000, 0.3
    g = twins.earth_terms(LAT, ALT)[0]
    u = np.tile([0.0, 0.0, -g, 0.0, 0.0, turn], (n, 1))
    x = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 3.0])
    yaw = 3.0 + turn * 0.01 * np.arange(1, n + 1)
    y = np.zeros((n, 6))
    y[:, 5] = (yaw + math.pi) % (2.0 * math.pi) - math.pi
    track = SlidingModeObserver(SlidingModeSettings(), x).run(u, y, np.tile([LAT, ALT], (n, 1)))
    assert np.abs(track["f"][:, 5]).max() < 2e-4  # the earth turns by 0.7e-4 rad/s


def test_a_row_that_is_not_whole_injects_nothing(healthy: ImuExperiment) -> None:
    x, y = measured(healthy, GS)
    broken = y.copy()
    broken[101, 2] = np.nan
    one = SlidingModeObserver(SlidingModeSettings(), x)
    track = one.run(healthy.u_m[:-1], broken[1:], healthy.env[:-1])
    assert not track["used"][100]
    assert np.count_nonzero(~track["used"]) == 1
    assert np.array_equal(track["f"][100], track["f"][99])
    assert np.all(np.isfinite(track["x"]))
    whole = followed(healthy)
    assert np.abs(track["x"][-1] - whole["x"][-1]).max() < 1e-6


def test_a_recording_in_two_parts_is_the_whole(healthy: ImuExperiment) -> None:
    x, y = measured(healthy, GS)
    one = SlidingModeObserver(SlidingModeSettings(), x)
    parts = [
        one.run(healthy.u_m[:-1][part], y[1:][part], healthy.env[:-1][part])
        for part in (slice(0, 1234), slice(1234, None))
    ]
    assert np.concatenate(parts).tobytes() == followed(healthy).tobytes()


@pytest.mark.parametrize("slope", [0.0, 2.0, -1.0])
def test_a_slope_that_cannot_be_stable_is_refused(slope: float) -> None:
    with pytest.raises(ValueError, match="slope"):
        SlidingModeObserver(SlidingModeSettings(slope=slope), np.zeros(6))


def test_arrays_of_different_length_are_refused(healthy: ImuExperiment) -> None:
    one = SlidingModeObserver(SlidingModeSettings(), healthy.x_ground[0])
    with pytest.raises(ValueError, match="outputs"):
        one.run(healthy.u_m[:5], healthy.y_ground[:4], healthy.env[:5])
