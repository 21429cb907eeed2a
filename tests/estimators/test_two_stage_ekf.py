"""The adaptive two-stage EKF against an independent implementation, its twin, and filterpy."""

from pathlib import Path

import numpy as np
import pytest

from estimators.baselines.numpy_twins_imu import TwinTwoStage
from estimators.two_stage_ekf import AS, GS, Settings, Status, TwoStageFilter

NAMES = {"f": "f", "x": "x", "x_var": "Pxdiag", "Qf": "Qfdiag_next", "gamma": "gamma"}


@pytest.fixture(scope="module", params=[GS, AS], ids=["GS", "AS"])
def flight(request: pytest.FixtureRequest) -> dict[str, np.ndarray]:
    oracle: Path = request.getfixturevalue("oracle")
    name = {GS: "GS", AS: "AS"}[request.param]
    with np.load(oracle / f"atsekf_{name}.npz") as data:
        return {"model": request.param, **data}


def made(flight: dict[str, np.ndarray], mode: str, adapt: str) -> TwoStageFilter:
    settings = Settings(
        model=flight["model"],
        mode="paper" if mode == "paper" else "exact",
        adapt=adapt == "adapt",
        dt_s=float(flight["dt"]),
        input_std=tuple(np.sqrt(np.diag(flight["Q"]))),
        output_std=tuple(np.sqrt(np.diag(flight["R"]))),
        fault_var=tuple(np.diag(flight["Pf0"])),
        fault_walk_var=tuple(np.diag(flight["Qf0"])),
        window=int(flight["N"]),
        fault_walk_floor=float(flight["Qf_floor"]),
        divide_by_dt=True,  # as printed; the file keeps it
    )
    return TwoStageFilter(settings, flight["x0"], flight["P0"])


@pytest.mark.parametrize("mode", ["paper", "exact"])
@pytest.mark.parametrize("adapt", ["fixed", "adapt"])
def test_every_mode_is_the_independent_implementation(
    flight: dict[str, np.ndarray], mode: str, adapt: str
) -> None:
    track = made(flight, mode, adapt).run(flight["um"], flight["y"][1:], flight["env"][:-1])
    assert np.all(track["status"] == Status.OK)
    for ours, theirs in NAMES.items():
        error = np.abs(track[ours] - flight[f"{mode}_{adapt}_{theirs}"]).max()
        # 13 s of rounding differences through a stable recursion
        assert error < 1e-10, (ours, error)


@pytest.mark.parametrize("mode", ["paper", "exact"])
def test_kernel_and_numpy_twin_agree(flight: dict[str, np.ndarray], mode: str) -> None:
    steps = 60
    compiled = made(flight, mode, "adapt")
    twin = TwinTwoStage.like(compiled.settings, flight["x0"], flight["P0"])
    for k in range(steps):
        where = flight["env"][k]
        assert compiled.predict(flight["um"][k], *where, float(flight["dt"])) is Status.OK
        assert compiled.update(flight["y"][k + 1]) is Status.OK
        twin.predict(flight["um"][k], where, float(flight["dt"]))
        twin.update(flight["y"][k + 1])
        assert np.abs(compiled.fault - twin.f).max() < 1e-11
        assert np.abs(compiled.state - twin.x).max() < 1e-11
        assert np.abs(compiled.fault_cov - twin.Pf).max() < 1e-13
        assert np.abs(compiled.state_cov - twin.Px).max() < 1e-13


def test_two_stages_are_the_augmented_filter_of_filterpy(flight: dict[str, np.ndarray]) -> None:
    pytest.importorskip("filterpy")
    from estimators.baselines.augmented_ekf import AugmentedEKF

    ours = made(flight, "exact", "fixed")
    theirs = AugmentedEKF(ours.settings, flight["x0"], flight["P0"], compiled=True)
    for k in range(300):
        for one in (ours, theirs):
            one.predict(flight["um"][k], *flight["env"][k], float(flight["dt"]))
            one.update(flight["y"][k + 1])
        assert np.abs(ours.fault - theirs.fault).max() < 1e-12
        # velocities are 100 m/s: their rounding is 1.4e-14
        assert np.abs(ours.state - theirs.state).max() < 1e-12
        assert np.abs(ours.fault_cov - theirs.fault_cov).max() < 1e-12
        assert np.abs(ours.state_cov - theirs.state_cov).max() < 1e-12


def test_a_run_is_the_same_steps_one_by_one_to_the_last_bit(
    flight: dict[str, np.ndarray],
) -> None:
    whole = made(flight, "exact", "adapt").run(flight["um"], flight["y"][1:], flight["env"][:-1])
    pieces = made(flight, "exact", "adapt")
    parts = []
    for part in np.split(np.arange(1300), [1, 2, 500, 777]):
        parts.append(
            pieces.run(flight["um"][part], flight["y"][1:][part], flight["env"][:-1][part])
        )
    assert np.concatenate(parts).tobytes() == whole.tobytes()
    single = made(flight, "exact", "adapt")
    for k in range(100):
        single.predict(flight["um"][k], *flight["env"][k], float(flight["dt"]))
        single.update(flight["y"][k + 1])
        assert np.array_equal(single.fault, whole["f"][k])
        assert single.nis == whole["nis"][k]


def test_covariances_stay_symmetric_and_positive(flight: dict[str, np.ndarray]) -> None:
    one = made(flight, "exact", "adapt")
    for k in range(1300):
        one.predict(flight["um"][k], *flight["env"][k], float(flight["dt"]))
        one.update(flight["y"][k + 1])
        if k % 50 == 0:
            for name in ("P", "Pf"):
                matrix = one.memory[name][0]
                assert np.array_equal(matrix, matrix.T)
                assert np.linalg.eigvalsh(matrix).min() > 0


def test_the_innovations_of_a_healthy_flight_are_consistent(
    flight: dict[str, np.ndarray],
) -> None:
    """Before the faults start the mean NIS of six rows is six, with a Qf as small as the truth.

    The airspeed model is wrong as soon as the wind changes, and says so.
    """
    steps = int(np.argmax(np.abs(flight["f_true"]).max(axis=1) > 0)) - 1
    assert steps > 200
    one = made(flight, "exact", "fixed")
    one.memory["Qf"] = 1e-12
    track = one.run(flight["um"][:steps], flight["y"][1 : steps + 1], flight["env"][:steps])
    mean = track["nis"][50:].mean()
    # mean of n values of chi-square with six degrees: six within 5 sqrt(12 / n)
    if flight["model"] == GS:
        assert abs(mean - 6.0) < 5 * np.sqrt(12.0 / (steps - 50))
    else:
        assert mean > 20.0


def test_wrong_lengths_and_windows_are_refused(flight: dict[str, np.ndarray]) -> None:
    with pytest.raises(ValueError, match="2 inputs, 1 outputs"):
        made(flight, "exact", "fixed").run(np.zeros((2, 6)), np.zeros((1, 6)), np.zeros((2, 2)))
    with pytest.raises(ValueError, match="window"):
        TwoStageFilter(Settings(window=51))
