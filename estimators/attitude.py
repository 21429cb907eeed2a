"""Rotations, each convention stated once: NED earth, FRD body, scalar-first quaternions.

================  =====================================================  ==========  ====
symbol            meaning                                                shape       unit
================  =====================================================  ==========  ====
phi, theta, psi   roll, pitch, yaw: yaw about D first, then pitch,       scalars     rad
                  then roll (3-2-1), so that
                  ``ned_from_frd = Rz(psi) Ry(theta) Rx(phi)``
q                 unit quaternion of ``ned_from_frd``, scalar first;     (4,)        1
                  q and -q are the same rotation
R                 ``ned_from_frd``: ``v_ned = R @ v_frd``                (3, 3)      1
r                 rotation vector: axis times angle, right-handed        (3,)        rad
omega             rate of the body against the earth, in body axes,      (3,)        rad/s
                  ``R' = R skew(omega)``
================  =====================================================  ==========  ====

A matrix named ``target_from_source`` takes the components of a vector in ``source`` to those in
``target``; products therefore read from right to left, ``ned_from_frd = ned_from_ref @
ref_from_frd``, and the same holds for :func:`quaternion_product`. All functions are kernels: they
take scalars or C-contiguous float64 arrays, allocate only what they return and check nothing.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.jit import kernel

__all__ = [
    "dcm_from_quaternion",
    "dcm_from_rotation_vector",
    "euler_from_dcm",
    "euler_from_quaternion",
    "euler_rows_from_quaternion_rows",
    "ned_from_frd",
    "normalised",
    "quaternion_conjugate",
    "quaternion_from_dcm",
    "quaternion_from_euler",
    "quaternion_from_rotation_vector",
    "quaternion_product",
    "rotation_vector_from_quaternion",
    "skew",
    "wrap",
]

Array = NDArray[np.float64]

TWO_PI = 2.0 * math.pi

SMALL_ANGLE_RAD = 1e-4
"""Below this the truncated series are exact to rounding; above it the quotients are well posed."""


@kernel
def wrap(angle_rad: float) -> float:
    """The same angle in (-pi, pi]; bit for bit unchanged when it already lies inside.

    Parameters
    ----------
    angle_rad : float or (n,) float64 [rad]
    """
    return angle_rad - TWO_PI * np.ceil((angle_rad - math.pi) / TWO_PI)  # type: ignore[no-any-return]


@kernel
def skew(v: Array) -> Array:
    """Cross-product matrix: ``skew(v) @ w == cross(v, w)``.

    Parameters
    ----------
    v : (3,) float64 [any]
    """
    S = np.zeros((3, 3))
    S[0, 1], S[0, 2] = -v[2], v[1]
    S[1, 0], S[1, 2] = v[2], -v[0]
    S[2, 0], S[2, 1] = -v[1], v[0]
    return S


@kernel
def ned_from_frd(phi: float, theta: float, psi: float) -> Array:
    """Rotation matrix of the Euler angles, ``Rz(psi) Ry(theta) Rx(phi)``.

    Parameters
    ----------
    phi, theta, psi : float [rad]
        Roll, pitch, yaw.
    """
    sp, cp = math.sin(phi), math.cos(phi)
    st, ct = math.sin(theta), math.cos(theta)
    ss, cs = math.sin(psi), math.cos(psi)
    R = np.empty((3, 3))
    R[0, 0], R[0, 1], R[0, 2] = ct * cs, sp * st * cs - cp * ss, cp * st * cs + sp * ss
    R[1, 0], R[1, 1], R[1, 2] = ct * ss, sp * st * ss + cp * cs, cp * st * ss - sp * cs
    R[2, 0], R[2, 1], R[2, 2] = -st, sp * ct, cp * ct
    return R


@kernel
def euler_from_dcm(R: Array) -> tuple[float, float, float]:
    """Roll, pitch, yaw of ``ned_from_frd`` [rad]; pitch in [-pi/2, pi/2].

    At the poles of the Euler angles roll and yaw are not separable: roll is then reported as zero.

    Parameters
    ----------
    R : (3, 3) float64 [1]
    """
    ct = math.hypot(R[2, 1], R[2, 2])
    theta = math.atan2(-R[2, 0], ct)
    if ct < 1e-12:
        return 0.0, theta, math.atan2(-R[0, 1], R[1, 1])
    return math.atan2(R[2, 1], R[2, 2]), theta, math.atan2(R[1, 0], R[0, 0])


@kernel
def quaternion_from_euler(phi: float, theta: float, psi: float) -> Array:
    """Unit quaternion of the Euler angles.

    Parameters
    ----------
    phi, theta, psi : float [rad]
        Roll, pitch, yaw.
    """
    sp, cp = math.sin(0.5 * phi), math.cos(0.5 * phi)
    st, ct = math.sin(0.5 * theta), math.cos(0.5 * theta)
    ss, cs = math.sin(0.5 * psi), math.cos(0.5 * psi)
    q = np.empty(4)
    q[0] = cp * ct * cs + sp * st * ss
    q[1] = sp * ct * cs - cp * st * ss
    q[2] = cp * st * cs + sp * ct * ss
    q[3] = cp * ct * ss - sp * st * cs
    return q


@kernel
def dcm_from_quaternion(q: Array) -> Array:
    """Rotation matrix of a unit quaternion.

    Parameters
    ----------
    q : (4,) float64 [1]
        Scalar first, of unit length (see :func:`normalised`).
    """
    w, x, y, z = q[0], q[1], q[2], q[3]
    R = np.empty((3, 3))
    R[0, 0] = w * w + x * x - y * y - z * z
    R[1, 1] = w * w - x * x + y * y - z * z
    R[2, 2] = w * w - x * x - y * y + z * z
    R[0, 1], R[1, 0] = 2.0 * (x * y - w * z), 2.0 * (x * y + w * z)
    R[0, 2], R[2, 0] = 2.0 * (x * z + w * y), 2.0 * (x * z - w * y)
    R[1, 2], R[2, 1] = 2.0 * (y * z - w * x), 2.0 * (y * z + w * x)
    return R


@kernel
def quaternion_from_dcm(R: Array) -> Array:
    """Unit quaternion of a rotation matrix, scalar part >= 0 (Shepperd's choice of the pivot).

    Parameters
    ----------
    R : (3, 3) float64 [1]
    """
    q = np.empty(4)
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    if trace > max(R[0, 0], R[1, 1], R[2, 2]):
        q[0] = 1.0 + trace
        q[1] = R[2, 1] - R[1, 2]
        q[2] = R[0, 2] - R[2, 0]
        q[3] = R[1, 0] - R[0, 1]
    else:
        i = 0
        if R[1, 1] > R[0, 0]:
            i = 1
        if R[2, 2] > R[i, i]:
            i = 2
        j, k = (i + 1) % 3, (i + 2) % 3
        q[0] = R[k, j] - R[j, k]
        q[1 + i] = 1.0 + R[i, i] - R[j, j] - R[k, k]
        q[1 + j] = R[j, i] + R[i, j]
        q[1 + k] = R[k, i] + R[i, k]
    scale = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    if q[0] < 0.0:
        scale = -scale
    return q * scale


@kernel
def euler_from_quaternion(q: Array) -> tuple[float, float, float]:
    """Roll, pitch, yaw of a unit quaternion [rad].

    Parameters
    ----------
    q : (4,) float64 [1]
        Scalar first, of unit length.
    """
    return euler_from_dcm(dcm_from_quaternion(q))


@kernel
def euler_rows_from_quaternion_rows(q: Array) -> Array:
    """Roll, pitch, yaw of each row, (n, 3) [rad].

    Parameters
    ----------
    q : (n, 4) float64 [1]
        Quaternions in rows; they need not be of unit length.
    """
    out = np.empty((q.shape[0], 3))
    for i in range(q.shape[0]):
        out[i, 0], out[i, 1], out[i, 2] = euler_from_quaternion(normalised(q[i]))
    return out


@kernel
def normalised(q: Array) -> Array:
    """The quaternion divided by its length (NaN when the length is zero or not finite).

    Parameters
    ----------
    q : (4,) float64 [any]
    """
    length = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    if not (0.0 < length < math.inf):
        return np.full(4, math.nan)
    return q * (1.0 / length)


@kernel
def quaternion_conjugate(q: Array) -> Array:
    """The inverse rotation: of ``target_from_source``, ``source_from_target``.

    Parameters
    ----------
    q : (4,) float64 [1]
    """
    out = -q
    out[0] = q[0]
    return out


@kernel
def quaternion_product(p: Array, q: Array) -> Array:
    """Hamilton product, the rotation ``R(p) @ R(q)``.

    Parameters
    ----------
    p, q : (4,) float64 [1]
    """
    out = np.empty(4)
    out[0] = p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3]
    out[1] = p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2]
    out[2] = p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1]
    out[3] = p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0]
    return out


@kernel
def dcm_from_rotation_vector(r: Array) -> Array:
    """Exponential of ``skew(r)`` (Rodrigues), exact to rounding for any angle.

    Parameters
    ----------
    r : (3,) float64 [rad]
    """
    return dcm_from_quaternion(quaternion_from_rotation_vector(r))


@kernel
def quaternion_from_rotation_vector(r: Array) -> Array:
    """Unit quaternion of a rotation about ``r`` by the angle ``|r|``.

    Parameters
    ----------
    r : (3,) float64 [rad]
    """
    angle2 = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
    half = 0.5 * math.sqrt(angle2)
    if half < SMALL_ANGLE_RAD:
        s = 0.5 * (1.0 - angle2 / 24.0 + angle2 * angle2 / 1920.0)
    else:
        s = 0.5 * math.sin(half) / half
    q = np.empty(4)
    q[0] = math.cos(half)
    q[1], q[2], q[3] = s * r[0], s * r[1], s * r[2]
    return q


@kernel
def rotation_vector_from_quaternion(q: Array) -> Array:
    """Rotation vector of a unit quaternion, of length at most pi.

    Parameters
    ----------
    q : (4,) float64 [1]
    """
    sign = 1.0 if q[0] >= 0.0 else -1.0
    s = math.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    w = sign * q[0]
    # 2 atan2(s, w) / s; its series in s / w where s is too small to divide by
    t = s / w if w > 0.0 else math.inf
    scale = 2.0 / w * (1.0 - t * t / 3.0) if t < SMALL_ANGLE_RAD else 2.0 * math.atan2(s, w) / s
    out = np.empty(3)
    for i in range(3):
        out[i] = sign * scale * q[1 + i]
    return out
