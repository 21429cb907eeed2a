"""Accelerations that an aircraft should have, and how each wing's damage would change them.

========  ==============================================================  ========  ============
symbol    meaning                                                         unit      samar2006
========  ==============================================================  ========  ============
euler     roll, pitch, yaw: ned_from_frd                                  rad       p in (1)
v_ned     velocity against the ground                                     m/s       v in (1)
omega     body rates p, q, r                                              rad/s     v in (1)
u         elevator, aileron, rudder                                       rad       u(t)
Omega     speed of the propeller                                          rad/s     zeta
w         wind that is known, the velocity the air moves toward           m/s       w_hat, (3)
rho       density of the air                                              kg/m^3
f         right lift loss, right drag increase, left ..., left ...        %         f
phi       d/dt of body velocity (3) and of the body rates (3)             m/s^2,    (6)
                                                                          rad/s^2
V, a, b   airspeed, angles of attack and of sideslip from v_ned - w       m/s, rad
========  ==============================================================  ========  ============

The map is instantaneous: forces and moments of the table of derivatives, lift and drag at the
centre of each wing (y = b/4 and -b/4), thrust and torque from the propeller's speed. Lift is linear
below the stall and a flat plate's above it; drag is parasitic plus induced.

Differs: the paper's accelerations are those of velocity in its earth axes; here they are of the
velocity in *body* axes, which leaves the signatures and the covariance of the residuals the same on
every course (omega x v is then part of phi). A measured airspeed, where there is one, replaces the
length of v_ned - w.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from estimators.jit import kernel

__all__ = [
    "AERODYNAMIC",
    "AXES",
    "BESIDE",
    "FAULTS",
    "INPUTS",
    "POSITIVE",
    "Airframe",
    "inputs_of",
    "predict_rows",
]

Array = NDArray[np.float64]

AXES = 6
"""Of phi: forward, right, down [m/s^2]; roll, pitch, yaw [rad/s^2]."""
FAULTS = ("right.lift", "right.drag", "left.lift", "left.drag")
BESIDE = ("travel_us", "travel_deg")
"""In an airframe's file, and no part of the model: how its servos move its surfaces."""
POSITIVE = (
    "mass_kg", "Jx_kg_m2", "Jy_kg_m2", "Jz_kg_m2", "area_m2", "span_m", "chord_m", "CLalpha",
    "oswald", "diameter_m",
)  # fmt: skip
"""Numbers that are above zero in every airframe."""
G0 = 9.80665
R_EARTH_M = 6_371_000.0

EULER, V_NED, OMEGA, U = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)
PROP, WIND, RHO, TAS, HEIGHT = 12, slice(13, 16), 16, 17, 18
INPUTS = 19
"""Columns of an input row, in the order of the slices above."""


@dataclass(frozen=True, slots=True)
class Airframe:
    """Mass, geometry and derivatives of an aircraft; angles in rad, rates made dimensionless.

    ``links/airframes/aerosonde.toml`` lists them with their meaning.
    """

    mass_kg: float
    Jx_kg_m2: float
    Jy_kg_m2: float
    Jz_kg_m2: float
    Jxz_kg_m2: float
    area_m2: float
    span_m: float
    chord_m: float
    CL0: float
    CLalpha: float
    CLq: float
    CLde: float
    stall_M: float
    stall_alpha_rad: float
    CDp: float
    oswald: float
    CDde: float
    CYbeta: float
    CYda: float
    CYdr: float
    Clbeta: float
    Clp: float
    Clr: float
    Clda: float
    Cldr: float
    Cm0: float
    Cmalpha: float
    Cmq: float
    Cmde: float
    Cnbeta: float
    Cnp: float
    Cnr: float
    Cnda: float
    Cndr: float
    diameter_m: float
    CT0: float
    CT1: float
    CT2: float
    CQ0: float
    CQ1: float
    CQ2: float

    @classmethod
    def of(cls, numbers: Mapping[str, float]) -> Airframe:
        """From a table of numbers; those of :data:`BESIDE` are passed over.

        Raises
        ------
        ValueError
            A number is missing, unknown, not finite, or zero or less where that cannot be: the
            message names it.
        """
        names = [field.name for field in fields(cls)]
        missing = [name for name in names if name not in numbers]
        if missing:
            raise ValueError(f"the airframe lacks {', '.join(missing)}")
        unknown = [name for name in numbers if name not in names and name not in BESIDE]
        if unknown:
            raise ValueError(f"the airframe has no use for {', '.join(unknown)}")
        wrong = [name for name in names if not math.isfinite(numbers[name])]
        if wrong:
            raise ValueError(f"not finite in the airframe: {', '.join(wrong)}")
        wrong = [name for name in POSITIVE if not numbers[name] > 0.0]
        if wrong:
            raise ValueError(f"not above zero in the airframe: {', '.join(wrong)}")
        if not numbers["Jxz_kg_m2"] ** 2 < numbers["Jx_kg_m2"] * numbers["Jz_kg_m2"]:
            raise ValueError("Jxz_kg_m2 is too large in the airframe: Jxz^2 < Jx Jz is needed")
        return cls(**{name: float(numbers[name]) for name in names})

    def row(self) -> Array:
        """All numbers in the order of the fields, for the kernels."""
        return np.array([getattr(self, field.name) for field in fields(self)])


AERODYNAMIC = (
    "CL0", "CLalpha", "CLq", "CLde", "CDp", "CDde", "CYbeta", "CYda", "CYdr",
    "Clbeta", "Clp", "Clr", "Clda", "Cldr", "Cm0", "Cmalpha", "Cmq", "Cmde",
    "Cnbeta", "Cnp", "Cnr", "Cnda", "Cndr", "CT0", "CT1", "CT2", "CQ0", "CQ1", "CQ2",
)  # fmt: skip
"""Numbers that a wind tunnel or a flight test would give, and get wrong."""


@kernel
def predict(c: Array, x: Array, f: Array, phi: Array) -> None:
    """The prediction model: phi of one input row with faults f.

    Parameters
    ----------
    c : (41,) float64
        :meth:`Airframe.row`.
    x : (INPUTS,) float64
    f : (4,) float64 [%]
    phi : (6,) float64, written

    Source: samar2006 II-A, IV-A.
    """
    (mass, Jx, Jy, Jz, Jxz, area, span, chord) = (
        c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7]
    )  # fmt: skip
    CL0, CLalpha, CLq, CLde, stall_M, stall_alpha = c[8], c[9], c[10], c[11], c[12], c[13]
    CDp, oswald, CDde = c[14], c[15], c[16]

    # body axes
    s_roll, c_roll = math.sin(x[0]), math.cos(x[0])
    s_pitch, c_pitch = math.sin(x[1]), math.cos(x[1])
    s_yaw, c_yaw = math.sin(x[2]), math.cos(x[2])
    m00, m01, m02 = c_pitch * c_yaw, c_pitch * s_yaw, -s_pitch
    m10 = s_roll * s_pitch * c_yaw - c_roll * s_yaw
    m11 = s_roll * s_pitch * s_yaw + c_roll * c_yaw
    m12 = s_roll * c_pitch
    m20 = c_roll * s_pitch * c_yaw + s_roll * s_yaw
    m21 = c_roll * s_pitch * s_yaw - s_roll * c_yaw
    m22 = c_roll * c_pitch
    u = m00 * x[3] + m01 * x[4] + m02 * x[5]
    v = m10 * x[3] + m11 * x[4] + m12 * x[5]
    w = m20 * x[3] + m21 * x[4] + m22 * x[5]
    an, ae, ad = x[3] - x[13], x[4] - x[14], x[5] - x[15]
    ua = m00 * an + m01 * ae + m02 * ad
    va = m10 * an + m11 * ae + m12 * ad
    wa = m20 * an + m21 * ae + m22 * ad

    V = max(math.sqrt(ua * ua + va * va + wa * wa), 1.0)
    alpha = math.atan2(wa, ua)
    beta = math.asin(max(-1.0, min(1.0, va / V)))
    if math.isfinite(x[17]):
        V = max(x[17], 1.0)
    p, q, r = x[6], x[7], x[8]
    de, da, dr = x[9], x[10], x[11]
    rho = x[16]
    force = 0.5 * rho * V * V * area
    p_hat, q_hat, r_hat = 0.5 * span * p / V, 0.5 * chord * q / V, 0.5 * span * r / V
    s_alpha, c_alpha = math.sin(alpha), math.cos(alpha)

    # lift and drag of both wings together
    linear = CL0 + CLalpha * alpha
    rise = math.exp(min(60.0, -stall_M * (alpha - stall_alpha)))
    fall = math.exp(min(60.0, stall_M * (alpha + stall_alpha)))
    stalled = (1.0 + rise + fall) / ((1.0 + rise) * (1.0 + fall))
    plate = 2.0 * s_alpha * abs(s_alpha) * c_alpha
    lift = force * ((1.0 - stalled) * linear + stalled * plate + CLq * q_hat + CLde * de)
    induced = linear * linear / (math.pi * oswald * span * span / area)
    drag = force * (CDp + induced + CDde * de)

    # each wing, at its centre: the right one at y = b/4
    right_lift, right_drag = 0.5 * lift * (1.0 - 0.01 * f[0]), 0.5 * drag * (1.0 + 0.01 * f[1])
    left_lift, left_drag = 0.5 * lift * (1.0 - 0.01 * f[2]), 0.5 * drag * (1.0 + 0.01 * f[3])
    right_x = right_lift * s_alpha - right_drag * c_alpha
    right_z = -right_lift * c_alpha - right_drag * s_alpha
    left_x = left_lift * s_alpha - left_drag * c_alpha
    left_z = -left_lift * c_alpha - left_drag * s_alpha
    arm = 0.25 * span

    # propeller
    D, CT0, CT1, CT2, CQ0, CQ1, CQ2 = c[34], c[35], c[36], c[37], c[38], c[39], c[40]
    n = x[12] / (2.0 * math.pi)
    thrust = rho * D * D * (CT0 * n * n * D * D + CT1 * n * D * V + CT2 * V * V)
    torque = rho * D * D * D * (CQ0 * n * n * D * D + CQ1 * n * D * V + CQ2 * V * V)

    X = right_x + left_x + thrust
    Y = force * (c[17] * beta + c[18] * da + c[19] * dr)
    Z = right_z + left_z
    roll = force * span * (c[20] * beta + c[21] * p_hat + c[22] * r_hat + c[23] * da + c[24] * dr)
    roll += arm * (right_z - left_z) - torque
    pitch = force * chord * (c[25] + c[26] * alpha + c[27] * q_hat + c[28] * de)
    yaw = force * span * (c[29] * beta + c[30] * p_hat + c[31] * r_hat + c[32] * da + c[33] * dr)
    yaw -= arm * (right_x - left_x)

    gravity = G0 * (1.0 - 2.0 * x[18] / R_EARTH_M)
    phi[0] = X / mass + m02 * gravity - (q * w - r * v)
    phi[1] = Y / mass + m12 * gravity - (r * u - p * w)
    phi[2] = Z / mass + m22 * gravity - (p * v - q * u)

    # J omega' = M - omega x J omega
    hx, hy, hz = Jx * p - Jxz * r, Jy * q, -Jxz * p + Jz * r
    roll -= q * hz - r * hy
    pitch -= r * hx - p * hz
    yaw -= p * hy - q * hx
    det = Jx * Jz - Jxz * Jxz
    phi[3] = (Jz * roll + Jxz * yaw) / det
    phi[4] = pitch / Jy
    phi[5] = (Jxz * roll + Jx * yaw) / det


@kernel
def predict_rows(c: Array, x: Array, f: Array, phi: Array) -> None:
    """:func:`predict` for many rows: x (n, INPUTS), f (n, 4) [%], phi (n, 6) written."""
    for k in range(len(x)):
        predict(c, x[k], f[k], phi[k])


def inputs_of(
    *,
    euler_rad: Array,
    vel_ned_m_s: Array,
    rate_rad_s: Array,
    surfaces_rad: Array,
    prop_rad_s: Array,
    wind_ned_m_s: Array,
    density_kg_m3: Array,
    height_m: Array,
    tas_m_s: Array | None = None,
) -> Array:
    """Input rows from columns.

    Parameters
    ----------
    euler_rad, vel_ned_m_s, rate_rad_s : (n, 3) float64
    surfaces_rad : (n, 3) float64
        Elevator (positive: nose down), aileron (positive: right wing down), rudder (positive: nose
        left).
    prop_rad_s : (n,) float64
    wind_ned_m_s : (n, 3) float64
        What is known of it.
    density_kg_m3, height_m : (n,) float64
        Height above sea level, for gravity.
    tas_m_s : (n,) float64, optional
        Measured true airspeed.
    """
    x = np.full((len(euler_rad), INPUTS), np.nan)
    x[:, EULER], x[:, V_NED], x[:, OMEGA] = euler_rad, vel_ned_m_s, rate_rad_s
    x[:, U], x[:, PROP], x[:, WIND] = surfaces_rad, prop_rad_s, wind_ned_m_s
    x[:, RHO], x[:, HEIGHT] = density_kg_m3, height_m
    if tas_m_s is not None:
        x[:, TAS] = tas_m_s
    return x
