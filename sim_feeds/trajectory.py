"""Truth: the flight of a fixed-wing aircraft that is kinematically exact over a rotating earth.

The path through the air (airspeed, climb angle, heading) is analytic, see
:mod:`sim_feeds.flightplan`; the wind adds a velocity whose derivative is known
(:mod:`sim_feeds.gusts`). Attitude follows from path, bank and lift curve by a chain of axis turns.
Specific force and rates are the derivatives of exactly these, so an independent strapdown
integration returns the same velocity and attitude up to its own integration error.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from math import ceil, radians
from typing import Final

import numpy as np
from numpy.typing import NDArray

from sim_feeds import earth
from sim_feeds.airframe import Airframe
from sim_feeds.flightplan import FlightPlan
from sim_feeds.gusts import GustResponse, respond
from sim_feeds.profile import Profile
from sim_feeds.rotation import chain, euler_from_matrix, quaternion_from_matrix, rotate_back
from sim_feeds.wind import Route, Wind

__all__ = ["SEED_OF_WIND", "Truth", "fly"]

Floats = NDArray[np.float64]

G0: Final = earth.STANDARD_GRAVITY_M_S2
SEED_OF_WIND: Final = 1
"""Child number of the wind's random stream; sensors and faults use others."""


@dataclass(frozen=True, slots=True)
class Truth:
    """What is so, on an even time grid; ``n`` samples, NED earth axes, FRD body axes.

    Attributes
    ----------
    t_s : (n,)
    lat_rad, lon_rad, height_m : (n,)
        Position on the sphere, height above it.
    agl_m : (n,)
        Height above the field.
    vel_ned_m_s, acc_ned_m_s2 : (n, 3)
        Ground velocity and the derivative of its NED components.
    ned_from_frd : (n, 3, 3)
    q_ned_from_frd : (n, 4)
        Scalar first, continuous in sign.
    euler_rad : (n, 3)
        Roll, pitch, yaw.
    specific_force_m_s2, rate_rad_s : (n, 3)
        What perfect accelerometers and gyros read.
    wind_ned_m_s : (n, 3)
        Velocity the air moves toward.
    air_frd_m_s : (n, 3)
        Velocity against the air in body axes (u, v, w of lu2016 eq. (15)).
    tas_m_s, cas_m_s, aoa_rad, ssa_rad : (n,)
    static_pa, impact_pa, temperature_k : (n,)
    thrust_acc_m_s2 : (n,)
        Path acceleration that the engine must give on top of level flight.
    airborne : (n,)
        0 on the wheels, 1 carried by the wings.
    """

    t_s: Floats
    lat_rad: Floats
    lon_rad: Floats
    height_m: Floats
    agl_m: Floats
    vel_ned_m_s: Floats
    acc_ned_m_s2: Floats
    ned_from_frd: Floats
    q_ned_from_frd: Floats
    euler_rad: Floats
    specific_force_m_s2: Floats
    rate_rad_s: Floats
    wind_ned_m_s: Floats
    air_frd_m_s: Floats
    tas_m_s: Floats
    cas_m_s: Floats
    aoa_rad: Floats
    ssa_rad: Floats
    static_pa: Floats
    impact_pa: Floats
    temperature_k: Floats
    thrust_acc_m_s2: Floats
    airborne: Floats

    @property
    def dt_s(self) -> float:
        """Grid spacing."""
        return float(self.t_s[1] - self.t_s[0])

    def at(self, t_s: Floats) -> Truth:
        """Truth at other times inside the flight: cubic for velocity and position, else linear."""
        step = self.dt_s
        x = np.clip((np.asarray(t_s) - self.t_s[0]) / step, 0.0, len(self.t_s) - 1.0)
        i = np.minimum(x.astype(int), len(self.t_s) - 2)
        u = x - i
        out = {}
        for f in fields(self):
            a = getattr(self, f.name)
            w = u.reshape(-1, *([1] * (a.ndim - 1)))
            out[f.name] = (1.0 - w) * a[i] + w * a[i + 1]
        w = u[:, None]
        v, a = self.vel_ned_m_s, self.acc_ned_m_s2
        bend = (1.0 - 2.0 * w) * (v[i] - v[i + 1]) + step * ((1.0 - w) * a[i] - w * a[i + 1])
        out["vel_ned_m_s"] += w * (1.0 - w) * bend
        out["q_ned_from_frd"] /= np.linalg.norm(out["q_ned_from_frd"], axis=1, keepdims=True)
        yaw = np.interp(x, np.arange(len(self.t_s)), np.unwrap(self.euler_rad[:, 2]))
        out["euler_rad"][:, 2] = (yaw + np.pi) % (2.0 * np.pi) - np.pi
        return Truth(**out)

    def every(self, step: int) -> Truth:
        """Every ``step``-th sample."""
        return replace(self, **{f.name: getattr(self, f.name)[::step] for f in fields(self)})


@dataclass(frozen=True, slots=True)
class _Path:
    """Path through the still air and the attitude that flies it, before any gust."""

    V: Floats
    V_rate: Floats
    gamma: Floats
    gamma_rate: Floats
    chi: Floats
    chi_rate: Floats
    mu: Floats
    mu_rate: Floats
    alpha: Floats
    alpha_rate: Floats
    share: Floats
    share_rate: Floats
    agl: Floats


def fly(
    plan: FlightPlan,
    wind: Wind | None = None,
    *,
    seed: int = 0,
    rate_hz: float = 200.0,
    lat_rad: float = radians(52.0),
    lon_rad: float = radians(4.4),
    field_m: float = 0.0,
    temperature_offset_k: float = 0.0,
) -> Truth:
    """Fly the plan in the wind.

    Parameters
    ----------
    plan
        Manoeuvres of one aircraft.
    wind
        None is calm.
    seed
        Of the turbulence.
    rate_hz
        Of the truth grid; sensors are sampled from it.
    lat_rad, lon_rad
        Start of the flight.
    field_m
        Height of the ground; landings come down to it.
    temperature_offset_k
        Deviation from the standard atmosphere.
    """
    dt = 1.0 / rate_hz
    t: Floats = np.arange(ceil(plan.time_s * rate_hz - 1e-9) + 1, dtype=np.float64) * dt
    path = _still_path(plan, t, field_m)
    route = Route(t, path.agl, path.V, path.chi)
    rng = np.random.default_rng([seed, SEED_OF_WIND])
    air = (wind or Wind()).velocity(route, rng)
    aloft = path.V[path.share > 0.5]
    reference = float(aloft.mean()) if len(aloft) else plan.airframe.cruise_m_s
    gust = respond(plan.airframe, air, path.chi, reference, dt)

    vel, acc = _velocity(path, gust)
    _meet_the_ground(plan, t, vel, acc, plan.start_height_m - field_m)
    matrix, rate = _attitude(path, gust)
    lat, lon, height = _position(t, vel, acc, lat_rad, lon_rad, plan.start_height_m)

    spin = earth.earth_rate_ned(lat)
    carry = earth.transport_rate_ned(lat, height, vel)
    force_ned = acc + np.cross(2.0 * spin + carry, vel)
    force_ned[:, 2] -= earth.gravity(lat, height)
    air_frd = rotate_back(matrix, vel - air)
    tas = np.linalg.norm(air_frd, axis=1)
    static = earth.static_pressure(height)
    temperature = earth.temperature(height, temperature_offset_k)
    # A pitot sees the flow along the body axis; an aircraft at rest in a tail wind reads nothing.
    impact = np.where(air_frd[:, 0] > 0.0, earth.impact_pressure(tas, static, temperature), 0.0)
    moving = tas > 1e-9
    return Truth(
        t_s=t,
        lat_rad=lat,
        lon_rad=lon,
        height_m=height,
        agl_m=height - field_m,
        vel_ned_m_s=vel,
        acc_ned_m_s2=acc,
        ned_from_frd=matrix,
        q_ned_from_frd=quaternion_from_matrix(matrix),
        euler_rad=euler_from_matrix(matrix),
        specific_force_m_s2=rotate_back(matrix, force_ned),
        rate_rad_s=rate + rotate_back(matrix, spin + carry),
        wind_ned_m_s=air,
        air_frd_m_s=air_frd,
        tas_m_s=tas,
        cas_m_s=earth.calibrated_airspeed(impact),
        aoa_rad=np.where(moving, np.arctan2(air_frd[:, 2], air_frd[:, 0]), 0.0),
        ssa_rad=np.where(moving, np.arcsin(air_frd[:, 1] / np.where(moving, tas, 1.0)), 0.0),
        static_pa=static,
        impact_pa=impact,
        temperature_k=temperature,
        thrust_acc_m_s2=path.V_rate + G0 * np.sin(path.gamma),
        airborne=path.share,
    )


def _still_path(plan: FlightPlan, t: Floats, field_m: float) -> _Path:
    """Path and trimmed attitude: bank of a coordinated turn, angle of attack of the lift curve."""
    a: Airframe = plan.airframe
    V, V1 = plan.speed(t), plan.speed(t, 1)
    g, g1, g2 = (plan.climb(t, k) for k in range(3))
    x, x1, x2 = (plan.heading(t, k) for k in range(3))
    s, s1 = plan.airborne(t), plan.airborne(t, 1)
    sg, cg = np.sin(g), np.cos(g)

    pull = V * x1 / G0
    mu = np.arctan(pull)
    m1 = (V1 * x1 + V * x2) / G0 / (1.0 + pull**2)
    sm, cm = np.sin(mu), np.cos(mu)

    # Load factor along the lift axis, and its derivative.
    curve = g1 * cm + x1 * cg * sm
    n = cg * cm + V / G0 * curve
    curve1 = g2 * cm - g1 * sm * m1 + x2 * cg * sm - x1 * sg * g1 * sm + x1 * cg * cm * m1
    n1 = -sg * g1 * cm - cg * sm * m1 + V1 / G0 * curve + V / G0 * curve1

    climb_rate = V * sg
    start = plan.start_height_m
    height = start + _integral(t, climb_rate, V1 * sg + V * cg * g1)
    rho = earth.density(height)
    sigma = rho / earth.density(0.0)
    # Density falls by (g / R + L) / T per metre in a constant lapse rate.
    fall = (G0 / earth.GAS_CONSTANT + earth.LAPSE_K_M) / earth.temperature(height)
    sigma1 = -sigma * fall * climb_rate

    flying = s > 0.0
    speed = np.where(flying, V, a.cruise_m_s)
    k = a.lift_constant / (sigma * speed**2)
    lift = k * n
    lift1 = k * (n1 - n * (2.0 * V1 / speed + sigma1 / sigma))
    rest = a.zero_lift_aoa_rad - a.ground_pitch_rad
    return _Path(
        V=V,
        V_rate=V1,
        gamma=g,
        gamma_rate=g1,
        chi=x,
        chi_rate=x1,
        mu=mu,
        mu_rate=m1,
        alpha=a.ground_pitch_rad + s * (rest + lift),
        alpha_rate=s1 * (rest + lift) + s * lift1,
        share=s,
        share_rate=s1,
        agl=np.maximum(height - field_m, 0.0),
    )


def _velocity(p: _Path, gust: GustResponse) -> tuple[Floats, Floats]:
    """NED velocity and its derivative: still-air path plus the airborne share of the wind's."""
    sg, cg, sx, cx = np.sin(p.gamma), np.cos(p.gamma), np.sin(p.chi), np.cos(p.chi)
    vel = np.stack([p.V * cg * cx, p.V * cg * sx, -p.V * sg], axis=1)
    level = p.V_rate * cg - p.V * sg * p.gamma_rate
    acc = np.stack(
        [
            level * cx - p.V * cg * sx * p.chi_rate,
            level * sx + p.V * cg * cx * p.chi_rate,
            -p.V_rate * sg - p.V * cg * p.gamma_rate,
        ],
        axis=1,
    )
    s, s1 = p.share[:, None], p.share_rate[:, None]
    vel += s * gust.vel_ned_m_s
    acc += s * gust.acc_ned_m_s2 + s1 * gust.vel_ned_m_s
    return vel, acc


def _attitude(p: _Path, gust: GustResponse) -> tuple[Floats, Floats]:
    """ned_from_frd and the body rate against the NED frame."""
    small = p.share[:, None] * gust.angles_rad
    small1 = p.share[:, None] * gust.rates_rad_s + p.share_rate[:, None] * gust.angles_rad
    return chain(
        [
            (2, p.chi, p.chi_rate),
            (1, p.gamma, p.gamma_rate),
            (0, p.mu, p.mu_rate),
            (1, p.alpha, p.alpha_rate),
            (2, small[:, 2], small1[:, 2]),
            (1, small[:, 1], small1[:, 1]),
            (0, small[:, 0], small1[:, 0]),
        ]
    )


def _meet_the_ground(
    plan: FlightPlan, t: Floats, vel: Floats, acc: Floats, start_agl_m: float
) -> None:
    """Correct the sink rate of each landing so that its touch-down is at the field's height.

    A smooth bump is added to the vertical velocity over the descent; its size follows from the
    height that the uncorrected descent would miss by.
    """
    for start, end in plan.landings:
        # Vertical gusts still act while the weight goes onto the wheels: aim at where they end.
        last = int(np.searchsorted(t, end + 2.0 * plan.airframe.surge_s**0.5))
        miss = start_agl_m - _integral(t[: last + 1], vel[: last + 1, 2], acc[: last + 1, 2])[-1]
        half = (end - start) / 2.0
        up = _bump(t, start, half)
        vel[:, 2] += miss / half * up[0]
        acc[:, 2] += miss / half * up[1]


def _bump(t: Floats, start_s: float, half_s: float) -> tuple[Floats, Floats]:
    """A smooth bump of height 1 and integral ``half_s``, and its derivative."""
    bump = Profile()
    bump.step(start_s, half_s, 1.0)
    bump.step(start_s + half_s, half_s, -1.0)
    return bump(t), bump(t, 1)


def _position(
    t: Floats, vel: Floats, acc: Floats, lat0: float, lon0: float, height0: float
) -> tuple[Floats, Floats, Floats]:
    """Latitude, longitude and height by fourth-order quadrature of the velocity."""
    height = height0 - _integral(t, vel[:, 2], acc[:, 2])
    radius = earth.EARTH_RADIUS_M + height
    lat = lat0 + _integral(
        t, vel[:, 0] / radius, acc[:, 0] / radius + vel[:, 0] * vel[:, 2] / radius**2
    )
    across = radius * np.cos(lat)
    shrink = -vel[:, 2] * np.cos(lat) - vel[:, 0] * np.sin(lat)
    lon = lon0 + _integral(
        t, vel[:, 1] / across, acc[:, 1] / across - vel[:, 1] * shrink / across**2
    )
    return lat, lon, height


def _integral(t: Floats, y: Floats, dy: Floats) -> Floats:
    """Running integral from values and derivatives (Hermite: error of order dt^4)."""
    h = np.diff(t)
    area = h / 2.0 * (y[1:] + y[:-1]) + h**2 / 12.0 * (dy[:-1] - dy[1:])
    return np.concatenate([[0.0], np.cumsum(area)])
