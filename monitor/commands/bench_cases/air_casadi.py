"""The air data horizon as a CasADi problem: the peer that solves the same thing.

The model is written out once more in CasADi's symbols (approximate model of wan2018, the one that
the paper times). The quadratic programme of one iteration is sqpmethod with the Gauss-Newton
Hessian and qrqp, compiled by the C compiler; the converged problem also goes to IPOPT.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["CasadiHorizon", "Horizon", "compiler"]

Array = NDArray[np.float64]

G0, R_AIR, GAMMA, T0_K, LAPSE = 9.80665, 287.05287, 1.4, 288.15, 6.5e-3


@dataclass(frozen=True)
class Horizon:
    """One window as arrays: (7, 4) tuning rows P Q R xl xu ul uu and the data of N samples."""

    t_s: float
    tuning: Array
    x_prior: Array
    x: Array
    u: Array
    y: Array
    theta: Array


def compiler() -> str | None:
    """C compiler on this machine, if any."""
    return shutil.which("gcc") or shutil.which("cc")


class CasadiHorizon:
    """CasADi's solvers for one window.

    Parameters
    ----------
    horizon : Horizon
    """

    def __init__(self, horizon: Horizon) -> None:
        import casadi as ca

        self._ca: Any = ca
        self.horizon = h = horizon
        N = len(h.x)
        P, Q, R = (np.sqrt(row) for row in h.tuning[:3])
        X, U = ca.SX.sym("X", 4, N), ca.SX.sym("U", 4, N - 1)
        prior, Y, TH = ca.SX.sym("prior", 4), ca.SX.sym("Y", 4, N), ca.SX.sym("TH", 6, N)
        residuals, defects = [(X[:, 0] - prior) / P], []
        for i in range(N):
            F, out = self._model(X[:, i], TH[:, i])
            residuals.append((Y[:, i] - out) / R)
            if i < N - 1:
                residuals.append(U[:, i] / Q)
                defects.append(F + h.t_s * U[:, i] - X[:, i + 1])
        w = ca.vertcat(ca.vec(X), ca.vec(U))
        p = ca.vertcat(prior, ca.vec(Y), ca.vec(TH))
        r, g = ca.vertcat(*residuals), ca.vertcat(*defects)
        self._problem = {"x": w, "p": p, "f": ca.sumsqr(r) / 2, "g": g}
        J = ca.jacobian(r, w)
        scale, multiplier = ca.SX.sym("lam_f"), ca.SX.sym("lam_g", g.size1())
        self._gauss_newton = ca.Function("H", [w, p, scale, multiplier], [scale * (J.T @ J)])
        bounds = [
            np.concatenate([np.tile(h.tuning[i], N), np.tile(h.tuning[i + 2], N - 1)])
            for i in (3, 4)
        ]
        self.arguments = {
            "x0": np.concatenate([h.x.ravel(), h.u.ravel()]),
            "p": np.concatenate([h.x_prior, h.y.ravel(), h.theta.ravel()]),
            "lbx": bounds[0],
            "ubx": bounds[1],
            "lbg": np.zeros(g.size1()),
            "ubg": np.zeros(g.size1()),
        }

    def _model(self, x: Any, th: Any) -> tuple[Any, Any]:
        """(x + t_s f(x), h(x)) of the approximate model (13)-(16)."""
        ca, t_s = self._ca, self.horizon.t_s
        alpha, W_x, W_z = x[0], x[2], x[3]
        V_g, pitch, q, A_x, A_z, z = (th[i] for i in range(6))
        s, c = ca.sin(alpha - pitch), ca.cos(alpha - pitch)
        f_alpha = -A_x * ca.sin(alpha) + A_z * ca.cos(alpha) + G0 * c
        f_v = A_x * ca.cos(alpha) + A_z * ca.sin(alpha) + G0 * s
        V_t = V_g - W_x * c - W_z * s
        T = T0_K - LAPSE * z
        p_bar = (T / T0_K) ** (G0 / (LAPSE * R_AIR))
        five = 5.0 * GAMMA * R_AIR
        rho = ((1.0 + V_t**2 / (five * T)) ** 3.5 - 1.0) * p_bar + 1.0
        V_c = np.sqrt(five * T0_K) * ca.sqrt(rho ** (1.0 / 3.5) - 1.0)
        F = x + t_s * ca.vertcat(f_alpha / V_g + q, f_v, 0.0, 0.0)
        return F, ca.vertcat(x[1], V_g * s + W_z, alpha, V_c)

    def sqp(self, iterations: int) -> Any:
        """CasADi's sqpmethod with qrqp, full steps, Gauss-Newton Hessian."""
        quiet = dict.fromkeys(
            ("print_header", "print_iteration", "print_status", "print_time"), False
        )
        inner = {
            "print_iter": False,
            "print_header": False,
            "print_info": False,
            "error_on_fail": False,
        }
        options = {
            **quiet, "qpsol": "qrqp", "qpsol_options": inner, "max_iter": iterations,
            "max_iter_ls": 0, "hess_lag": self._gauss_newton, "error_on_fail": False,
        }  # fmt: skip
        return self._ca.nlpsol("S", "sqpmethod", self._problem, options)

    def ipopt(self) -> Any:
        """IPOPT with the exact Hessian, to its default tolerance."""
        options = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes"}}
        return self._ca.nlpsol("S", "ipopt", self._problem, options)

    def compiled(self, solver: Any) -> Any:
        """The solver as machine code: CasADi's C through the compiler with -O3.

        Raises
        ------
        RuntimeError
            When there is no compiler or it fails.
        """
        cc = compiler()
        if cc is None:
            raise RuntimeError("no C compiler")
        folder = Path(tempfile.mkdtemp(prefix="casadi-"))
        generator = self._ca.CodeGenerator("horizon.c")
        generator.add(solver)
        generator.generate(f"{folder}/")
        library = folder / "horizon.so"
        command = [cc, "-O3", "-march=native", "-fPIC", "-shared", "-o", str(library)]
        subprocess.run(
            [*command, str(folder / "horizon.c"), "-lm"], check=True, capture_output=True
        )
        function = self._ca.external("S", str(library))
        shutil.rmtree(folder)
        return function

    def solve(self, solver: Any) -> tuple[Array, Array]:
        """Solution (x, u) of a solver from the horizon's linearisation point."""
        N = len(self.horizon.x)
        w = np.array(solver(**self.arguments)["x"]).ravel()
        return w[: 4 * N].reshape(N, 4), w[4 * N :].reshape(N - 1, 4)

    def caller(self, make: Callable[[], Any]) -> Callable[[], object]:
        """The ordinary call, by keyword with arrays; the solver is made on the first call."""
        made: list[Any] = []

        def call() -> object:
            if not made:
                made.append(make())
            return made[0](**self.arguments)

        return call

    def buffered(self, make: Callable[[], Any]) -> Callable[[], object]:
        """The call through CasADi's buffers, which converts nothing: its least overhead."""
        made: list[Any] = []

        def call() -> object:
            if not made:
                function = make()
                buffer, evaluate = function.buffer()
                sizes = {"x0": 0, "p": 1, "lbx": 2, "ubx": 3, "lbg": 4, "ubg": 5}
                keep = [(i, np.ascontiguousarray(self.arguments[k])) for k, i in sizes.items()]
                keep += [
                    (6, np.zeros_like(self.arguments["x0"])),
                    (7, np.zeros_like(self.arguments["lbg"])),
                ]
                for i, array in keep:
                    buffer.set_arg(i, memoryview(array.data))
                result = np.zeros_like(self.arguments["x0"])
                buffer.set_res(0, memoryview(result.data))
                made.extend([evaluate, keep, result, buffer, function])
            made[0]()
            return made[2]

        return call
