"""Wind: the velocity the air moves toward, in NED axes.

A :class:`Wind` is a sum of components, each a function of time, height, airspeed and direction of
flight: constant, ramps in time, shear with height, discrete gusts, Dryden turbulence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import cos, pi, radians, sin, sqrt
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from sim_feeds.profile import Profile

__all__ = [
    "Constant",
    "Dryden",
    "Gust",
    "HeightShear",
    "Ramp",
    "Route",
    "Wind",
    "toward",
]

Floats = NDArray[np.float64]
FOOT_M: Final = 0.3048


@dataclass(frozen=True, slots=True)
class Route:
    """Where the air is asked for its velocity: the aircraft's path on an even time grid.

    Attributes
    ----------
    t_s, agl_m, tas_m_s, heading_rad
        (n,) time, height above the ground, true airspeed, direction of the path through the air.
    """

    t_s: Floats
    agl_m: Floats
    tas_m_s: Floats
    heading_rad: Floats

    @staticmethod
    def still(t_s: Floats, tas_m_s: float, agl_m: float = 1500.0) -> Route:
        """A straight northbound path at constant speed and height."""
        one = np.ones_like(t_s)
        return Route(t_s, agl_m * one, tas_m_s * one, 0.0 * one)


def toward(speed_m_s: float, direction_deg: float, down_m_s: float = 0.0) -> Floats:
    """NED velocity of air that moves toward a direction (not: comes from), (3,) [m/s]."""
    a = radians(direction_deg)
    return np.array([speed_m_s * cos(a), speed_m_s * sin(a), down_m_s])


class Component(Protocol):
    """One part of the wind."""

    def velocity(self, route: Route, rng: np.random.Generator) -> Floats:
        """(n, 3) float64 [m/s, NED]."""
        ...


@dataclass(frozen=True, slots=True)
class Constant:
    """The same everywhere and always."""

    ned_m_s: Floats

    def velocity(self, route: Route, rng: np.random.Generator) -> Floats:
        return np.tile(self.ned_m_s, (len(route.t_s), 1))


@dataclass(frozen=True, slots=True)
class Ramp:
    """Changes by ``change_ned_m_s`` between two times, smoothly, and stays."""

    start_s: float
    end_s: float
    change_ned_m_s: Floats

    def velocity(self, route: Route, rng: np.random.Generator) -> Floats:
        step = Profile()
        step.step(self.start_s, self.end_s - self.start_s, 1.0)
        return step(route.t_s)[:, None] * self.change_ned_m_s


@dataclass(frozen=True, slots=True)
class Gust:
    """Discrete 1-cosine gust of MIL-F-8785C: up within ``rise_s``, held, down within ``rise_s``."""

    start_s: float
    rise_s: float
    hold_s: float
    peak_ned_m_s: Floats

    def velocity(self, route: Route, rng: np.random.Generator) -> Floats:
        t = route.t_s - self.start_s
        up = np.clip(t / self.rise_s, 0.0, 1.0)
        down = np.clip((t - self.rise_s - self.hold_s) / self.rise_s, 0.0, 1.0)
        shape = 0.5 * (np.cos(pi * down) - np.cos(pi * up))
        return shape[:, None] * self.peak_ned_m_s


@dataclass(frozen=True, slots=True)
class HeightShear:
    """Boundary layer: grows with a power of the height above ground up to a reference height."""

    ned_m_s: Floats
    """At and above the reference height."""
    reference_m: float = 300.0
    exponent: float = 0.15

    def velocity(self, route: Route, rng: np.random.Generator) -> Floats:
        ratio = np.clip(route.agl_m / self.reference_m, 2.0 / self.reference_m, 1.0)
        return (ratio**self.exponent)[:, None] * self.ned_m_s


@dataclass(frozen=True, slots=True)
class Dryden:
    """Dryden turbulence, with exact stationary statistics on the grid.

    Without fixed values, intensity and scale follow MIL-F-8785C: below 1000 ft they depend on
    height and on the wind at 20 ft, above 2000 ft the scale is 1750 ft and the intensity
    ``high_std_m_s``, linear in between.

    Attributes
    ----------
    wind_6m_m_s
        Mean wind 20 ft above ground [m/s]; 7.7 light, 15 moderate, 23 severe.
    high_std_m_s
        Standard deviation above 2000 ft [m/s].
    fixed_std_m_s, fixed_scale_m
        The same for all axes and heights; lu2016 section 2.2.1 has 3.54 m/s and 530 m.

    Differs: lu2016 prints (28) with 1 + (L w / V)^2 in the denominator of the lateral and vertical
    spectra; Dryden's has its square, which is what integrates to the variance.
    """

    wind_6m_m_s: float = 7.7
    high_std_m_s: float = 1.5
    fixed_std_m_s: float | None = None
    fixed_scale_m: float | None = None
    high_scale_ft: float = 1750.0
    """Scale above 2000 ft; 2500 ft for the von Karman form."""

    def scales(self, agl_m: Floats) -> tuple[Floats, Floats]:
        """Standard deviations and scale lengths along u, v, w: (n, 3) [m/s], (n, 3) [m].

        Source: mil8785c section 3.7.3.4.
        """
        feet = np.clip(agl_m / FOOT_M, 10.0, None)
        low = np.minimum(feet, 1000.0)
        factor = 0.177 + 0.000823 * low
        mix = np.clip((feet - 1000.0) / 1000.0, 0.0, 1.0)
        vertical_std = 0.1 * self.wind_6m_m_s
        level_std = vertical_std / factor**0.4
        level_scale = low / factor**1.2 * FOOT_M
        high_scale = self.high_scale_ft * FOOT_M

        def blend(below: Floats | float, above: float) -> Floats:
            return np.asarray((1.0 - mix) * below + mix * above)

        level = blend(level_std, self.high_std_m_s)
        std = np.stack([level, level, blend(vertical_std, self.high_std_m_s)], axis=1)
        level = blend(level_scale, high_scale)
        scale = np.stack([level, level, blend(low * FOOT_M, high_scale)], axis=1)
        if self.fixed_std_m_s is not None:
            std = np.full_like(std, self.fixed_std_m_s)
        if self.fixed_scale_m is not None:
            scale = np.full_like(scale, self.fixed_scale_m)
        return std, scale

    def velocity(self, route: Route, rng: np.random.Generator) -> Floats:
        std, scale = self.scales(route.agl_m)
        tas = np.maximum(route.tas_m_s, 5.0)
        step = np.diff(route.t_s, append=2 * route.t_s[-1] - route.t_s[-2])
        age = (step * tas)[:, None] / scale
        noise = rng.standard_normal((len(route.t_s), 5))
        along = std[:, 0] * _first_order(age[:, 0], noise[:, 0])
        across = std[:, 1] * _second_order(age[:, 1], noise[:, 1:3])
        vertical = std[:, 2] * _second_order(age[:, 2], noise[:, 3:5])
        c, s = np.cos(route.heading_rad), np.sin(route.heading_rad)
        return np.stack([c * along - s * across, s * along + c * across, vertical], axis=1)


def _first_order(age: Floats, noise: Floats) -> Floats:
    """Unit-variance process with transfer 1 / (1 + s); ``age`` is the step over its time."""
    keep = np.exp(-age)
    kick = np.sqrt(-np.expm1(-2.0 * age)) * noise
    out = np.empty_like(noise)
    x = out[0] = noise[0]
    for k in range(len(noise) - 1):
        x = keep[k] * x + kick[k + 1]
        out[k + 1] = x
    return out


def _second_order(age: Floats, noise: Floats) -> Floats:
    """Unit-variance process with transfer (1 + sqrt(3) s) / (1 + s)^2.

    In partial fractions sqrt(3) / (1 + s) + (1 - sqrt(3)) / (1 + s)^2: two first-order lags z1, z2
    in series with stationary covariance [[1, 1/2], [1/2, 1/2]], stepped exactly.
    """
    e = np.exp(-age)
    # Noise covariance P - Phi P Phi' with Phi = e [[1, 0], [age, 1]], and its Cholesky factor.
    q11 = 1.0 - e**2
    q12 = 0.5 - e**2 * (age + 0.5)
    q22 = 0.5 - e**2 * (age**2 + age + 0.5)
    l11 = np.sqrt(q11)
    l21 = q12 / l11
    l22 = np.sqrt(np.maximum(q22 - l21**2, 0.0))
    kick1 = (l11[:-1] * noise[1:, 0]).tolist()
    kick2 = (l21[:-1] * noise[1:, 0] + l22[:-1] * noise[1:, 1]).tolist()
    z = np.empty((len(noise), 2))
    a, b = float(noise[0, 0]), 0.5 * float(noise[0, 0]) + 0.5 * float(noise[0, 1])
    z[0] = a, b
    for k, (decay, lag) in enumerate(zip(e[:-1].tolist(), age[:-1].tolist(), strict=True)):
        a, b = decay * a + kick1[k], decay * (lag * a + b) + kick2[k]
        z[k + 1] = a, b
    return np.asarray((sqrt(3.0) * z[:, 0] + (1.0 - sqrt(3.0)) * z[:, 1]) / sqrt(2.0))


@dataclass(frozen=True, slots=True)
class Wind:
    """The sum of its components; none is calm air."""

    components: Sequence[Component] = field(default_factory=tuple)

    def velocity(self, route: Route, rng: np.random.Generator) -> Floats:
        """(n, 3) float64 [m/s, NED]; each component draws from its own child of ``rng``."""
        total = np.zeros((len(route.t_s), 3))
        for component, child in zip(self.components, rng.spawn(len(self.components)), strict=True):
            total += component.velocity(route, child)
        return total
