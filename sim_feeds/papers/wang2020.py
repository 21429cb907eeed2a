"""The simulated two-spool engine of wang2020 section IV, as arrays.

Every constant stands in ``wang2020.toml`` beside this module. One seed gives one run: inputs,
engine with process noise, and four outputs with noise and faults; another law of noise leaves the
engine and the moments of the faults as they are.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim_feeds.papers.bundled import text_of
from sim_feeds.papers.streams import FAULT_STREAM, INPUT_STREAM, NOISE_STREAM, PROCESS_STREAM

__all__ = [
    "NOISE_LAWS",
    "EngineExperiment",
    "EngineScenario",
    "NoiseLaw",
    "wang2020_experiment",
    "wang2020_scenario",
]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
NoiseLaw = Literal["gaussian", "laplace", "cauchy"]

NOISE_LAWS: Final[tuple[NoiseLaw, ...]] = ("gaussian", "laplace", "cauchy")


@dataclass(frozen=True, slots=True)
class EngineScenario:
    """``wang2020.toml``; n = 2 speeds, r = 2 inputs, m = 4 outputs, all of them dimensionless.

    Attributes
    ----------
    runs, duration_s, sample_s
        How many seeds, and how long and how finely each is simulated.
    A, B, C : (n, n), (n, r), (m, n)
        The engine, eq. (19).
    start : (n,)
        True speeds at time 0.
    process_std
        Noise of each speed in one sample.
    outputs
        What the channels are called.
    input_mean, sinusoids, amplitude, frequency_hz
        Inputs (r,) as a mean and a number of sinusoids, amplitudes and frequencies drawn between
        these.
    noise
        Law -> its standard deviations (Cauchy: scales), (m,).
    fault_free : (m,)
        True probability that a channel works at a moment.
    low, high
        A faulty output is uniform between these.
    permanent, permanent_from_s
        Channels that never work after this time.
    filter_start, filter_fault_free, variation_limit
        What the estimators are told: initial speeds, lambda, Delta.
    speed_rpm : (n,)
        Full scale of the speeds.
    """

    runs: int
    duration_s: float
    sample_s: float
    A: Floats
    B: Floats
    C: Floats
    start: Floats
    process_std: float
    outputs: tuple[str, ...]
    input_mean: Floats
    sinusoids: int
    amplitude: tuple[float, float]
    frequency_hz: tuple[float, float]
    noise: dict[NoiseLaw, Floats]
    fault_free: Floats
    low: float
    high: float
    permanent: tuple[int, ...]
    permanent_from_s: float
    filter_start: Floats
    filter_fault_free: Floats
    variation_limit: float
    speed_rpm: Floats

    @property
    def Q(self) -> Floats:
        """Covariance of the process noise, (n, n)."""
        return self.process_std**2 * np.eye(len(self.A))

    @property
    def R(self) -> Floats:
        """Variances of the Gaussian output noise, (m,)."""
        return self.noise["gaussian"] ** 2


@cache
def wang2020_scenario() -> EngineScenario:
    """Read the scenario file."""
    t = tomllib.loads(text_of("wang2020.toml"))
    engine, inputs, faults, told = t["engine"], t["inputs"], t["faults"], t["filter"]
    (low_a, high_a), (low_f, high_f) = inputs["amplitude"], inputs["frequency_hz"]
    return EngineScenario(
        runs=t["runs"],
        duration_s=t["duration_s"],
        sample_s=t["sample_s"],
        A=_fixed(engine["a"]),
        B=_fixed(engine["b"]),
        C=_fixed(engine["c"]),
        start=_fixed(engine["start"]),
        process_std=engine["process_std"],
        outputs=tuple(engine["outputs"]),
        input_mean=_fixed(inputs["mean"]),
        sinusoids=inputs["sinusoids"],
        amplitude=(low_a, high_a),
        frequency_hz=(low_f, high_f),
        noise={law: _fixed(*t["noise"][law].values()) for law in NOISE_LAWS},
        fault_free=_fixed(faults["fault_free"]),
        low=faults["low"],
        high=faults["high"],
        permanent=tuple(faults["permanent"]),
        permanent_from_s=faults["permanent_from_s"],
        filter_start=_fixed(told["start"]),
        filter_fault_free=_fixed(told["fault_free"]),
        variation_limit=told["variation_limit"],
        speed_rpm=_fixed(t["limits"]["speed_rpm"]),
    )


def _fixed(values: ArrayLike) -> Floats:
    """An array that nobody changes by accident: the scenario is shared."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


@dataclass(frozen=True, slots=True)
class EngineExperiment:
    """One run; row k of every array but `u` is valid at ``t_s[k]``, and `u[k]` leads up to it.

    Attributes
    ----------
    t_s : (N,)
        From one sample after time 0 on.
    u : (N, 2)
        Fuel flow and nozzle area over the sample that ends at ``t_s[k]``.
    x : (N, 2)
        True speeds of the low- and high-pressure compressor.
    y : (N, 4)
        Outputs with noise and faults.
    works : (N, 4) bool
        Whether the output is fault-free, gamma of eq. (2).
    """

    t_s: Floats
    u: Floats
    x: Floats
    y: Floats
    works: Bools


def wang2020_experiment(seed: int, noise: NoiseLaw = "gaussian") -> EngineExperiment:
    """Simulate one run.

    Parameters
    ----------
    seed
        Of inputs, process noise, output noise and faults, each with a stream of its own.
    noise
        Law of the output noise.
    """
    s = wang2020_scenario()
    steps = round(s.duration_s / s.sample_s)
    t_s: Floats = s.sample_s * np.arange(1, steps + 1, dtype=np.float64)
    u = _inputs(t_s - s.sample_s, np.random.default_rng([seed, INPUT_STREAM]))
    pushed = u @ s.B.T + s.process_std * np.random.default_rng(
        [seed, PROCESS_STREAM]
    ).standard_normal((steps, len(s.A)))
    x = np.empty((steps, len(s.A)))
    before = s.start
    for k in range(steps):
        x[k] = before = s.A @ before + pushed[k]
    draws = np.random.default_rng([seed, FAULT_STREAM])
    works = draws.random((steps, len(s.C))) < s.fault_free
    dead = t_s > s.permanent_from_s + 0.5 * s.sample_s
    for i in s.permanent:
        works[dead, i] = False
    anything = draws.uniform(s.low, s.high, works.shape)
    y = x @ s.C.T + _noise(noise, works.shape, np.random.default_rng([seed, NOISE_STREAM]))
    return EngineExperiment(t_s=t_s, u=u, x=x, y=np.where(works, y, anything), works=works)


def _inputs(t_s: Floats, rng: np.random.Generator) -> Floats:
    """Sums of sinusoids with drawn amplitudes, frequencies and phases."""
    s = wang2020_scenario()
    shape = (len(s.input_mean), s.sinusoids)
    amplitude = rng.uniform(*s.amplitude, shape)
    turns = rng.uniform(*s.frequency_hz, shape) * t_s[:, None, None] + rng.random(shape)
    u: Floats = s.input_mean + (amplitude * np.sin(2.0 * np.pi * turns)).sum(axis=2)
    return u


def _noise(law: NoiseLaw, shape: tuple[int, ...], rng: np.random.Generator) -> Floats:
    size = wang2020_scenario().noise[law]
    unit: Floats
    match law:
        case "gaussian":
            unit = rng.standard_normal(shape)
        case "laplace":
            unit = rng.laplace(scale=np.sqrt(0.5), size=shape)
        case "cauchy":
            unit = rng.standard_cauchy(shape)
    return size * unit
