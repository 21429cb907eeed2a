"""The monotone programme of the wing's faults, against general solvers called directly.

Every contender solves the same windows, one after the other, each from cold. Ours gets residuals
and signatures and forms the programme's matrices within its time. The peers get the same programme
as a sparse one in f, its matrices formed outside the time; within it they take the new numbers
through their own ``update`` (the pattern is set up once) and solve. All tolerances are the peers'
defaults; ours is tighter.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.baselines import numpy_twins_map as twin
from estimators.monotone_map import CONTINUED, normal_rows, solve_window, window_work_size
from estimators.monotone_qp import SOLVED, TOLERANCE
from estimators.wing_faults import EXTRA
from monitor.commands.bench_cases import BenchCase, Measured

__all__ = ["Windows", "cases", "clarabel_peer", "piqp_peer"]

Array = NDArray[np.float64]

WINDOWS = 16
LEVELS = 4
AXES = 6
LAM = np.ones(LEVELS)
R_INV = np.eye(LEVELS)
F_BAR = np.zeros(LEVELS)

SIGNATURES = np.array(
    [
        [-0.0031, -0.0046, -0.0031, -0.0046],
        [0.0, 0.0, 0.0, 0.0],
        [0.0498, -0.0003, 0.0498, -0.0003],
        [0.488, 0.0005, -0.488, -0.0005],
        [0.0, 0.0, 0.0, 0.0],
        [0.0473, 0.0206, -0.0473, -0.0206],
    ]
)
"""Per % of right lift, right drag, left lift, left drag of an Aerosonde in level flight: forward,
right and down in m/s^2, roll, pitch and yaw in rad/s^2."""
GUSTS = np.array([[0.0, 0.2, 0.0, -1.0, 0.0, -0.2], [-0.15, 0.0, 1.3, 0.0, 1.1, 0.0]])
"""What wind that is not known does to the residuals: from the side, and from below. Same units."""
REST = 0.1
"""Part of each residual that is not in these proportions."""
CORRELATION = 0.98
"""Of one residual with the next."""


class Windows:
    """``WINDOWS`` windows of N rows along one recording with a step and a ramp.

    Attributes
    ----------
    y, S
        List of the windows' rows, contiguous.
    W : (6, 6)
        Inverse covariance of the noise.
    programmes
        (H, q) of each window, prior included, for the peers.
    """

    def __init__(self, N: int, seed: int = 1) -> None:
        rng = np.random.default_rng(seed)
        rows = N + 10 * WINDOWS
        t = np.arange(rows)
        speed = 1.0 + 0.1 * np.sin(0.05 * t)
        S = speed[:, None, None] ** 2 * SIGNATURES
        S[:, 4, :] = 0.002 * np.sin(0.07 * t)[:, None]
        f = np.zeros((rows, LEVELS))
        f[rows // 2 :, 0] = 10.0
        f[:, 1] = 0.05 * np.maximum(t - rows // 4, 0)
        size = np.sqrt((GUSTS**2).sum(axis=0))
        e = rng.normal(size=(rows, 2)) @ GUSTS + REST * size * rng.normal(size=(rows, AXES))
        for k in range(1, rows):
            e[k] = CORRELATION * e[k - 1] + np.sqrt(1.0 - CORRELATION**2) * e[k]
        y = np.einsum("kij,kj->ki", S, f) + e
        parts = [slice(10 * i, 10 * i + N) for i in range(WINDOWS)]
        self.N = N
        self.W = np.linalg.inv(GUSTS.T @ GUSTS + EXTRA * np.diag(size**2))
        self.y = [np.ascontiguousarray(y[part]) for part in parts]
        self.S = [np.ascontiguousarray(S[part]) for part in parts]
        self.programmes = [
            twin.window_terms(*twin.normal_rows(y, S, self.W), LAM, R_INV, F_BAR, printed=False)
            for y, S in zip(self.y, self.S, strict=True)
        ]

    def solver(self) -> Callable[[], tuple[Array, Array]]:
        """Ours: a function that solves all windows and returns costs and newest levels."""
        N, slope = self.N, 1.0 / LAM
        H = np.empty((N, LEVELS, LEVELS))
        q, s, z, f = np.empty((4, N, LEVELS))
        work = np.empty(window_work_size(N, LEVELS))

        def run() -> tuple[Array, Array]:
            cost, newest = np.empty(WINDOWS), np.empty((WINDOWS, LEVELS))
            for i, (y, S) in enumerate(zip(self.y, self.S, strict=True)):
                normal_rows(y, S, self.W, H, q)
                status, _, cost[i] = solve_window(
                    CONTINUED, H, q, slope, R_INV, F_BAR, False, s, z, f, TOLERANCE, work
                )
                if status != SOLVED:
                    raise RuntimeError(f"window {i}: status {status}")
                newest[i] = f[-1]
            return cost, newest

        return run


def _sparse(H: Array, q: Array) -> tuple[Any, Any]:
    """Upper triangle of the programme's matrix, and the matrix D of the steps, as scipy has them.

    The blocks are full patterns: a zero in one window is no zero in another.
    """
    from scipy import sparse

    N, p, _ = H.shape
    k, i, j = np.nonzero(np.broadcast_to(np.triu(np.ones((p, p))), H.shape))
    P = sparse.csc_matrix((H[k, i, j], (k * p + i, k * p + j)), shape=(N * p, N * p))
    D = sparse.eye(N * p, format="csc") - sparse.eye(N * p, k=-p, format="csc")
    return P, sparse.csc_matrix(D)


def clarabel_peer(windows: Windows) -> Callable[[], tuple[Array, Array]]:
    """Clarabel through its Python class: ``update(P=values, q=values)`` and ``solve()``."""
    import clarabel

    numbers = [(_sparse(H, q)[0], q.ravel().copy()) for H, q in windows.programmes]
    P, D = _sparse(*windows.programmes[0])
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.presolve_enable = False  # as data updates need
    n = len(numbers[0][1])
    cones = [clarabel.NonnegativeConeT(n)]
    solver = clarabel.DefaultSolver(P, numbers[0][1], -D, np.zeros(n), cones, settings)
    values = [(P.data, q) for P, q in numbers]

    def run() -> tuple[Array, Array]:
        cost, newest = np.empty(WINDOWS), np.empty((WINDOWS, LEVELS))
        for i, (P, q) in enumerate(values):
            solver.update(P=P, q=q)
            solution = solver.solve()
            if solution.status != clarabel.SolverStatus.Solved:
                raise RuntimeError(f"clarabel, window {i}: {solution.status}")
            cost[i] = solution.obj_val
            newest[i] = solution.x[-LEVELS:]
        return cost, newest

    return run


def piqp_peer(windows: Windows) -> Callable[[], tuple[Array, Array]]:
    """PIQP's sparse solver: ``update(P, c)`` and ``solve()``."""
    import piqp

    numbers = []
    for H, q in windows.programmes:
        P, D = _sparse(H, q)
        numbers.append((P, q.ravel().copy()))
    n = len(numbers[0][1])
    solver = piqp.SparseSolver()
    solver.settings.verbose = False
    solver.setup(*numbers[0], None, None, D, np.zeros(n), np.full(n, np.inf))

    def run() -> tuple[Array, Array]:
        cost, newest = np.empty(WINDOWS), np.empty((WINDOWS, LEVELS))
        for i, (P, q) in enumerate(numbers):
            solver.update(P=P, c=q)
            if solver.solve() != piqp.PIQP_SOLVED:
                raise RuntimeError(f"piqp, window {i}: not solved")
            cost[i] = solver.result.info.primal_obj
            newest[i] = solver.result.x[-LEVELS:]
        return cost, newest

    return run


def cases() -> list[BenchCase]:
    """The programme of 50 and of 200 rows; a peer that is not installed is named."""
    return [_case(50), _case(200)]


def _case(N: int) -> BenchCase:
    windows = Windows(N)
    ours = windows.solver()
    peers: dict[str, Callable[[], tuple[Array, Array]]] = {}
    missing = []
    for name, make in (("clarabel", clarabel_peer), ("piqp", piqp_peer)):
        if importlib.util.find_spec(name) and importlib.util.find_spec("scipy"):
            peers[name] = make(windows)
        else:
            missing.append(name)

    def apart() -> Measured:
        cost, newest = ours()
        worst, told = 0.0, []
        for name, peer in peers.items():
            its_cost, its_newest = peer()
            difference = float(np.abs((its_cost - cost) / cost).max())
            levels = float(np.abs(its_newest - newest).max())
            worst = max(worst, difference)
            told.append(f"{name}: optimum {difference:.1e}, newest faults {levels:.1e} %.")
        return Measured(worst, note=" ".join(told))

    return BenchCase(
        f"mhmap_n{N}",
        unit="worst rel. difference of the optimum",
        run=ours,
        calls=WINDOWS,
        peers=peers,
        missing=tuple(missing),
        value=apart if peers else None,
        note=f"a window of {N} rows and {LEVELS} faults, from cold: ours from residuals and "
        "signatures, the peers from matrices formed outside the time, through their update().",
    )
