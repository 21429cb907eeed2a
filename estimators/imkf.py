"""Estimate a linear system's state from channels that fail and recover: Wang et al. (2020).

At every sample each channel either works (its output is C x and noise) or is faulty (its output is
anything). The filter corrects its prediction under every combination of the two, weighs the
combinations with how well they explain the outputs, and merges them into one Gaussian: it keeps no
record of past innovations and has no threshold to tune.

==============  ================================================  ==============  ==============
symbol          meaning                                           shape           wang2020
==============  ================================================  ==============  ==============
x, P            state estimate and its covariance                 (n,) (n, n)     (15) (16)
A, B, C         model of one sample: x+ = A x + B u, y = C x      (n, n) ...      (1)
Q, r            covariance of process noise; variances of output  (n, n) (m,)     (1)
u, y            input over the sample that ends now; outputs now  (r,) (m,)       (1)
gamma_j         combination j, 1: works; channel 1 is the most    (m,)            (5) (6)
                significant bit of j, j = 0: all are faulty
lambda          prior probability that a channel works            (m,)            (3)
h               the same with memory of what was seen             (m,)
xi_j            probability of combination j given the outputs    (2^m,)          (14)
w               probability that a channel works, given the       (m,)
                outputs: sum of the xi_j whose bit is set
Delta           largest believable change of x in one sample      [of x]          Algorithm 1
==============  ================================================  ==============  ==============

States and outputs may have any unit; that of a probability density over the outputs is theirs.

Differs
-------
(7) (8)
    The information form, the Kalman filter on the working channels, and one scalar correction after
    the other are algebraically the same; the last is computed. R must be diagonal, as in the paper.
(11) (14)
    A density of one output cannot be compared with one of two: the paper compares them and thereby
    assumes that a faulty output is uniform on [0, 1]. Here a faulty channel contributes the density
    1 / range, ``ln xi_j = ln P(gamma_j) + ln N(e_j; 0, S_j) + sum over faulty i of ln(1/range_i)``;
    the filter is then the same in any unit. Weights are added as logarithms: four outliers at once
    leave (14) as printed with 0 / 0.
j = 0
    (5) leaves out that all channels are faulty, so that one of them must always be believed; the
    threshold Delta of Algorithm 1 is to catch that. With `all_faulty` the combination takes part
    like any other (its correction is the prediction), and Delta is not needed.
lambda
    The paper's has no memory: what has been faulty for a minute is believed like new. `memory_s`
    gives each channel a health ``h += (w - h) dt / memory_s``, which takes lambda's place within
    [`health_floor`, `health_ceiling`].
missing outputs
    A channel whose output is not finite splits no evidence and keeps its health.

A frozen channel is not told by this filter alone: its reading stays believable for as long as the
process noise could have kept the state there, and one of two equally precise channels must win.

Source: H. Wang, D. Liu, T. Chen, X. Qin, IEEE Access 8 (2020), docs/references ``wang2020``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estimators import imkf_kernels as kernels

__all__ = ["MAX_CHANNELS", "IntermittentFilter", "LinearModel", "Settings", "Status", "Track"]

Array = NDArray[np.float64]

MAX_CHANNELS = 8
"""2^8 combinations take some twenty times as long as 2^3; more sensors of one thing are rare."""


class Status(IntEnum):
    """What became of one sample; of several reasons the largest."""

    OK = kernels.OK
    MISSING = kernels.MISSING
    """No channel had a finite output: the prediction is the estimate."""
    HELD = kernels.HELD
    """An input was not finite: the last finite one stood in (0 before there was one)."""
    REJECTED = kernels.REJECTED
    """The estimate jumped by more than the variation limit and was not taken."""
    IMPOSSIBLE = kernels.IMPOSSIBLE
    """No combination can explain the outputs: the prediction is the estimate."""


@dataclass(frozen=True, slots=True)
class LinearModel:
    """A linear system sampled every `dt_s`, eq. (1).

    Attributes
    ----------
    A, B, C : (n, n), (n, r), (m, n) float64
        State, input and output matrix.
    Q : (n, n) float64
        Covariance of the process noise of one sample.
    r : (m,) float64
        Variances of the outputs' noise.
    dt_s
        Sample time [s].
    """

    A: Array
    B: Array
    C: Array
    Q: Array
    r: Array
    dt_s: float

    def __post_init__(self) -> None:
        for name in ("A", "B", "C", "Q", "r"):
            array = np.array(getattr(self, name), dtype=np.float64, order="C")
            if not np.isfinite(array).all():
                raise ValueError(f"{name} is not finite")
            object.__setattr__(self, name, array)
        n, m = len(self.A), len(self.C)
        shapes = {"A": (n, n), "B": (n, self.B.shape[-1]), "C": (m, n), "Q": (n, n), "r": (m,)}
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise ValueError(f"{name} has shape {getattr(self, name).shape}, not {shape}")
        if not 1 <= m <= MAX_CHANNELS:
            raise ValueError(f"{m} channels, not 1 to {MAX_CHANNELS}")
        if not (self.r > 0.0).all():
            raise ValueError("variances of the outputs must be positive")
        if not self.dt_s > 0.0:
            raise ValueError(f"sample time is {self.dt_s} s")

    def scaled(self, x: ArrayLike, u: ArrayLike, y: ArrayLike) -> LinearModel:
        """The same system in other units: each new quantity is `scale` times the old one.

        Parameters
        ----------
        x, u, y : (n,), (r,), (m,) float64
            Scales of states, inputs and outputs.
        """
        X, U, Y = (np.asarray(scale, dtype=np.float64) for scale in (x, u, y))
        return replace(
            self,
            A=X[:, None] * self.A / X,
            B=X[:, None] * self.B / U,
            C=Y[:, None] * self.C / X,
            Q=X[:, None] * self.Q * X,
            r=Y**2 * self.r,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """How the combinations are weighed; the defaults are the deployed form.

    Attributes
    ----------
    fault_free : (m,)
        lambda, prior probability that a channel works.
    ranges : (m,)
        Width of what a faulty channel may read [units of y]; None: 1, as the paper assumes.
    all_faulty
        Whether all channels may be faulty at once (j = 0).
    memory_s
        Time over which a channel's health follows what was seen [s], at least one sample; None: no
        memory.
    health_floor, health_ceiling
        Health is used within these. At the floor a dead channel that comes back is believed again
        after some samples of agreement; the ceiling keeps a good channel open to doubt.
    variation_limit
        Delta [units of x, Euclidean norm over one sample].
    on_rejection
        What stands after a rejection: x and P of the sample before ("keep", as printed), or the
        prediction.
    """

    fault_free: tuple[float, ...]
    ranges: tuple[float, ...] | None = None
    all_faulty: bool = True
    memory_s: float | None = 0.5
    health_floor: float = 0.02
    health_ceiling: float = 0.99
    variation_limit: float = math.inf
    on_rejection: Literal["keep", "predict"] = "keep"

    @classmethod
    def paper(cls, fault_free: tuple[float, ...], variation_limit: float) -> Settings:
        """Algorithm 1 as printed."""
        return cls(
            fault_free=fault_free,
            all_faulty=False,
            memory_s=None,
            variation_limit=variation_limit,
        )

    def __post_init__(self) -> None:
        if not all(0.0 <= p <= 1.0 for p in self.fault_free):
            raise ValueError(f"fault-free probabilities {self.fault_free} are not within 0 and 1")
        if self.ranges is not None and not all(0.0 < width < math.inf for width in self.ranges):
            raise ValueError(f"ranges {self.ranges} are not positive")
        if not 0.0 < self.health_floor < self.health_ceiling < 1.0:
            raise ValueError("the health's floor and ceiling must part 0, floor, ceiling and 1")
        if self.memory_s is not None and not self.memory_s > 0.0:
            raise ValueError(f"memory is {self.memory_s} s")
        if not self.variation_limit > 0.0:
            raise ValueError(f"variation limit is {self.variation_limit}")


@dataclass(frozen=True, slots=True)
class Track:
    """Estimates over N samples.

    Attributes
    ----------
    x, P : (N, n), (N, n, n) float64
        State and covariance.
    works : (N, m) float64
        w, probability that the channel worked at that sample; its prior, within floor and ceiling,
        where it was missing.
    health : (N, m) float64
        h after that sample, not clipped.
    ln_evidence : (N,) float64
        Logarithm of (14)'s denominator [1 / units of y]. Where it falls below -745 the printed
        form underflows to 0 / 0.
    all_faulty : (N,) float64
        Probability that every channel was faulty; what remains when it is the model that fails.
    status : (N,) uint8
        :class:`Status`.
    weights : (N, 2^m) float64
        xi_j; no rows unless asked for.
    """

    x: Array
    P: Array
    works: Array
    health: Array
    ln_evidence: Array
    all_faulty: Array
    status: NDArray[np.uint8]
    weights: Array


class IntermittentFilter:
    """State of a linear system from channels that may fail at any sample.

    Parameters
    ----------
    model, settings
        The system, and how its channels fail.
    x, P : (n,), (n, n) float64
        Initial estimate and covariance.
    """

    def __init__(self, model: LinearModel, settings: Settings, x: ArrayLike, P: ArrayLike) -> None:
        n, m = len(model.A), len(model.C)
        ranges = settings.ranges or (1.0,) * m
        for name, values in (("fault-free probabilities", settings.fault_free), ("ranges", ranges)):
            if len(values) != m:
                raise ValueError(f"{len(values)} {name} for {m} channels")
        self.model, self.settings = model, settings
        self._model = kernels.Model(
            model.A, model.B, model.C, model.Q, model.r, np.log(np.asarray(ranges, np.float64))
        )
        memory_s = settings.memory_s
        self._rules = kernels.Rules(
            first=0 if settings.all_faulty else 1,
            delta=float(settings.variation_limit),
            keep=settings.on_rejection == "keep",
            tau=0.0 if memory_s is None else max(memory_s / model.dt_s, 1.0),
            floor=float(settings.health_floor),
            ceiling=float(settings.health_ceiling),
        )
        leaves = 2**m
        self._memory = kernels.Memory(
            x=np.zeros(n),
            P=np.zeros((n, n)),
            h=np.array(settings.fault_free, dtype=np.float64),
            u=np.zeros(model.B.shape[1]),
            xm=np.zeros(n),
            Pm=np.zeros((n, n)),
            g=np.zeros(n),
            xj=np.zeros((leaves, n)),
            Pj=np.zeros((leaves, n, n)),
            lnj=np.zeros(leaves),
            xi=np.zeros(leaves),
        )
        self.restart(x, P)

    def restart(self, x: ArrayLike, P: ArrayLike) -> None:
        """Begin anew from this estimate; the channels' health stays what it was."""
        self._memory.x[:] = np.asarray(x, dtype=np.float64)
        self._memory.P[:] = np.asarray(P, dtype=np.float64)

    @property
    def state(self) -> Array:
        """State estimate, (n,) float64 [units of x]."""
        return self._memory.x.copy()

    @property
    def cov(self) -> Array:
        """Its covariance, (n, n) float64."""
        return self._memory.P.copy()

    @property
    def health(self) -> Array:
        """Probability that each channel works at the next sample, (m,) float64; not clipped."""
        return self._memory.h.copy()

    @property
    def outputs(self) -> tuple[Array, Array]:
        """What the channels should read and its standard deviation, each (m,) [units of y]."""
        C = self.model.C
        return C @ self._memory.x, np.sqrt(np.einsum("ia,ab,ib->i", C, self._memory.P, C))

    @property
    def nbytes(self) -> int:
        """Bytes of everything that the filter works with, the model included."""
        return sum(a.nbytes for a in (*self._model, *self._memory))

    def step(self, u: ArrayLike, y: ArrayLike) -> Status:
        """Advance by one sample.

        Parameters
        ----------
        u : (r,) float64
            Input over the sample that ends now.
        y : (m,) float64 [units of y]
            Outputs now; NaN where a channel is missing.

        Returns
        -------
        Status
            As :class:`Status` says; the estimate is always usable.
        """
        return Status(int(self.run(np.asarray(u)[None], np.asarray(y)[None]).status[0]))

    def run(self, u: ArrayLike, y: ArrayLike, *, weights: bool = False) -> Track:
        """Advance sample by sample; any split of the rows into calls gives the same estimates.

        Parameters
        ----------
        u : (N, r) float64
            Inputs; row k holds over the sample that ends at row k of `y`.
        y : (N, m) float64 [units of y]
            Outputs; NaN where a channel is missing.
        weights
            Keep xi_j of every sample.
        """
        n, m, r = len(self.model.A), len(self.model.C), self.model.B.shape[1]
        inputs = np.ascontiguousarray(u, dtype=np.float64).reshape(-1, r)
        outputs = np.ascontiguousarray(y, dtype=np.float64).reshape(-1, m)
        N = len(outputs)
        if len(inputs) != N:
            raise ValueError(f"{len(inputs)} inputs for {N} outputs")
        track = Track(
            x=np.empty((N, n)),
            P=np.empty((N, n, n)),
            works=np.empty((N, m)),
            health=np.empty((N, m)),
            ln_evidence=np.empty(N),
            all_faulty=np.empty(N),
            status=np.empty(N, np.uint8),
            weights=np.empty((N if weights else 0, 2**m)),
        )
        out = kernels.Out(
            track.x,
            track.P,
            track.works,
            track.health,
            track.ln_evidence,
            track.all_faulty,
            track.status,
            track.weights,
        )
        kernels.run(self._model, self._rules, self._memory, inputs, outputs, out)
        return track
