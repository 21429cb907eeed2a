"""Von Karman turbulence: white noise through shaping filters.

====== ============================================================ ===========
symbol meaning                                                      unit
====== ============================================================ ===========
V      airspeed                                                     m/s
L      scale length along u, v, w                                   m
T      L / V                                                        s
sigma  standard deviation of u, v, w                                m/s
b      wing span                                                    m
====== ============================================================ ===========

The spectra of MIL-F-8785C are those of filters with a fractional power, driven by noise of
one-sided density 1 per rad/s:

    H_u = sigma sqrt(2 T / pi) F(T s)                    F(s) = (1 + 1.339 s)^(-5/6)
    H_v = sigma sqrt(T / pi) F(T s) (1 + 2.187 T s) / (1 + 1.339 T s)           and H_w likewise

F is replaced by five lags and four leads in series. In units of T a filter is a constant linear
system, which is stepped exactly; the first state is drawn from its stationary distribution.

Source: mil8785c section 3.7 (spectra, scales, intensities, angular rates).

Differs: the usual rational filters of second and third order lose a fifth of the power at
omega T = 30 and half of it at 150. A small aircraft flies where that matters: 200 m up at 25 m/s,
omega T = 150 is 2 Hz. These hold the spectrum within 2 % to omega T = 3000.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Final

import numpy as np
from numpy.typing import NDArray

from sim_feeds.gusts import discrete_noise, linear_response, recurrence
from sim_feeds.wind import Dryden, Route

__all__ = [
    "LATERAL",
    "LONGITUDINAL",
    "AirRotation",
    "Shaping",
    "VonKarman",
    "exact_density",
    "rotation_of_the_air",
]

Floats = NDArray[np.float64]


def exact_density(x: Floats, *, lateral: bool) -> Floats:
    """One-sided spectrum in units of sigma^2 T at x = omega T; ``lateral`` is also vertical.

    Source: mil8785c section 3.7.1.1.
    """
    y2 = np.square(1.339 * np.asarray(x))
    if lateral:
        return np.asarray((1.0 + 8.0 / 3.0 * y2) / (1.0 + y2) ** (11.0 / 6.0) / pi)
    return np.asarray(2.0 / pi / (1.0 + y2) ** (5.0 / 6.0))


@dataclass(frozen=True, slots=True)
class Shaping:
    """A shaping filter: ``gain`` times leads (1 + z s) over lags (1 + p s), s in units of 1 / T.

    ``gain`` squared is the one-sided density at zero frequency in units of sigma^2 T. There is a
    lag more than there are leads.
    """

    gain: float
    leads: tuple[float, ...]
    lags: tuple[float, ...]

    def density(self, x: Floats) -> Floats:
        """One-sided density in units of sigma^2 T at x = omega T."""
        y2 = np.square(x)[..., None]
        num, den = np.square(self.leads), np.square(self.lags)
        return np.asarray(self.gain**2 * np.prod(1.0 + num * y2, -1) / np.prod(1.0 + den * y2, -1))

    def system(self) -> tuple[Floats, Floats, Floats]:
        """The sections in series as A (m, m), B (m,), C (m,) in units of T.

        The first section is a lag; each other, (1 + z s) / (1 + p s), passes z / p of what it is
        given straight on.
        """
        m = len(self.lags)
        A, B = np.zeros((m, m)), np.zeros(m)
        state, direct = np.zeros(m), 1.0  # what a section is given, by states and by the noise
        for i, p in enumerate(self.lags):
            z = self.leads[i - 1] if i else 0.0
            A[i], B[i] = state / p, direct / p
            A[i, i] -= 1.0 / p
            state, direct = z / p * state, z / p * direct
            state[i] += 1.0 - z / p
        return A, B, self.gain * state

    def series(self, n: int, age: float, rng: np.random.Generator) -> Floats:
        """Draw n samples of the process for sigma = 1, ``age`` = dt / T apart.

        One-sided density 1 per rad/s is a two-sided one of 1/2, hence an intensity of pi.
        """
        A, B, C = self.system()
        step, kick, start = discrete_noise(A, pi * np.outer(B, B), age)
        noise = rng.standard_normal((n, len(B)))
        drive = noise @ kick.T
        drive[0] = start @ noise[0]
        return np.asarray(recurrence(step, drive) @ C)


FRACTIONAL_LEADS: Final = (0.3217, 0.04593, 0.006449, 0.000876)
FRACTIONAL_LAGS: Final = (1.2036, 0.23375, 0.03312, 0.004647, 0.000612)
"""F(s), fitted to (1 + 1.339 s)^(-5/6): power within 1.5 % for omega T up to 3000."""
LONGITUDINAL: Final = Shaping((2.0 / pi) ** 0.5, FRACTIONAL_LEADS, FRACTIONAL_LAGS)
LATERAL: Final = Shaping(
    (1.0 / pi) ** 0.5,
    (1.339 * (8.0 / 3.0) ** 0.5, *FRACTIONAL_LEADS),
    (FRACTIONAL_LAGS[0], 1.339, *FRACTIONAL_LAGS[1:]),
)


@dataclass(frozen=True, slots=True)
class VonKarman:
    """Von Karman turbulence, a component of :class:`sim_feeds.wind.Wind`.

    Intensities and scales follow height and wind as in :class:`sim_feeds.wind.Dryden`, but for the
    scale above 2000 ft, which is 2500 ft for the von Karman form.

    Attributes
    ----------
    wind_6m_m_s
        Mean wind 20 ft above ground [m/s].
    high_std_m_s
        Standard deviation above 2000 ft [m/s].
    """

    wind_6m_m_s: float = 7.7
    high_std_m_s: float = 1.5

    def scales(self, agl_m: Floats) -> tuple[Floats, Floats]:
        """Standard deviations and scale lengths along u, v, w: (n, 3) [m/s], (n, 3) [m]."""
        return Dryden(self.wind_6m_m_s, self.high_std_m_s, high_scale_ft=2500.0).scales(agl_m)

    def along_path(self, route: Route, rng: np.random.Generator) -> Floats:
        """Turbulence along the path through the air, to its right and down, (n, 3) [m/s].

        Where speed or height vary, the process is drawn on an even grid of the distance in scale
        lengths and read off between its points.
        """
        std, scale = self.scales(route.agl_m)
        tas = np.maximum(route.tas_m_s, 5.0)
        step = np.diff(route.t_s, append=2 * route.t_s[-1] - route.t_s[-2])
        out = np.empty_like(std)
        for axis, child in enumerate(rng.spawn(3)):
            age = step * tas / scale[:, axis]
            distance = np.concatenate([[0.0], np.cumsum(age[:-1])])
            finest = float(age.min())
            n = int(np.ceil(distance[-1] / finest - 1e-6)) + 1
            shaping = LONGITUDINAL if axis == 0 else LATERAL
            drawn = shaping.series(n, finest, child)
            out[:, axis] = std[:, axis] * np.interp(distance, finest * np.arange(n), drawn)
        return out

    def velocity(self, route: Route, rng: np.random.Generator) -> Floats:
        """(n, 3) float64 [m/s, NED]."""
        along, across, down = self.along_path(route, rng).T
        c, s = np.cos(route.heading_rad), np.sin(route.heading_rad)
        return np.stack([c * along - s * across, s * along + c * across, down], axis=1)


@dataclass(frozen=True, slots=True)
class AirRotation:
    """Rotation of the air around the aircraft, (n,) each [rad/s]; p is 0 where left out."""

    p: Floats
    q: Floats
    r: Floats


def rotation_of_the_air(
    across_m_s: Floats, down_m_s: Floats, *, tas_m_s: float, span_m: float, dt_s: float
) -> AirRotation:
    """Pitch and yaw rate of the air from the gradients of the gusts along the path.

    Air that turns like a rigid body at rates q and r has w = -q x and v = r x. Flying through a
    frozen field turns d/dx into (1 / V) d/dt; the aircraft's size smooths it:

        q = -(s / V) / (1 + (4 b / pi V) s) w        r = (s / V) / (1 + (3 b / pi V) s) v

    Source: mil8785c section 3.7.5, whose q_g and r_g are what the aircraft feels: -q and -r.
    """
    slope = []
    for gust, length in ((down_m_s, 4.0 * span_m / pi), (across_m_s, 3.0 * span_m / pi)):
        rate = np.array([[tas_m_s / length]])
        smooth, _ = linear_response(-rate, rate, gust[:, None], dt_s, gust[:1])
        slope.append((gust - smooth[:, 0]) / length)
    return AirRotation(np.zeros_like(down_m_s), -slope[0], slope[1])
