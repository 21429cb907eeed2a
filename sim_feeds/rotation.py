"""Rotations of whole time histories: matrices, quaternions, Euler angles, chains of axis turns.

A matrix ``ned_from_frd`` takes body (forward, right, down) components to NED components.
Quaternions are scalar first. All functions work on arrays with the time on the first axis.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "axis_matrix",
    "chain",
    "euler_from_matrix",
    "matrix_from_euler",
    "matrix_from_quaternion",
    "quaternion_from_matrix",
    "rotate",
    "rotate_back",
]

Floats = NDArray[np.float64]
AxisTurn = tuple[int, Floats, Floats]
"""Axis (0, 1, 2), angle (n,) [rad], rate of the angle (n,) [rad/s]."""


def axis_matrix(axis: int, angle: Floats) -> Floats:
    """Matrix that turns the frame about one of its axes by ``angle``, (n, 3, 3)."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    m = np.zeros((*np.shape(angle), 3, 3))
    m[..., axis, axis] = 1.0
    m[..., i, i] = m[..., j, j] = c
    m[..., i, j], m[..., j, i] = -s, s
    return m


def chain(turns: Iterable[AxisTurn]) -> tuple[Floats, Floats]:
    """Successive turns about the moving axes: the matrix and its body rate, exactly.

    Returns
    -------
    matrix : (n, 3, 3) float64
        reference_from_body.
    rate : (n, 3) float64 [rad/s]
        Rotation of the body against the reference, in body axes.
    """
    matrix: Floats | None = None
    rate: Floats | None = None
    for axis, angle, angle_rate in turns:
        step = axis_matrix(axis, angle)
        if matrix is None or rate is None:
            matrix, rate = step, np.zeros((*np.shape(angle), 3))
        else:
            matrix, rate = matrix @ step, rotate_back(step, rate)
        rate[..., axis] += angle_rate
    if matrix is None or rate is None:
        raise ValueError("a chain needs at least one turn")
    return matrix, rate


def rotate(matrix: Floats, vector: Floats) -> Floats:
    """``matrix @ vector`` at every time."""
    return np.asarray(np.einsum("...ij,...j->...i", matrix, vector))


def rotate_back(matrix: Floats, vector: Floats) -> Floats:
    """``matrix.T @ vector`` at every time."""
    return np.asarray(np.einsum("...ji,...j->...i", matrix, vector))


def matrix_from_euler(phi: Floats, theta: Floats, psi: Floats) -> Floats:
    """ned_from_frd of roll, pitch and yaw [rad]."""
    return axis_matrix(2, psi) @ axis_matrix(1, theta) @ axis_matrix(0, phi)


def euler_from_matrix(ned_from_frd: Floats) -> Floats:
    """Roll, pitch and yaw, (n, 3) [rad]; yaw within (-pi, pi]."""
    m = ned_from_frd
    return np.stack(
        [
            np.arctan2(m[..., 2, 1], m[..., 2, 2]),
            -np.arcsin(np.clip(m[..., 2, 0], -1.0, 1.0)),
            np.arctan2(m[..., 1, 0], m[..., 0, 0]),
        ],
        axis=-1,
    )


def quaternion_from_matrix(ned_from_frd: Floats) -> Floats:
    """Unit quaternion, scalar first, continuous along the first axis, (n, 4)."""
    m = ned_from_frd
    # The four ways to write the quaternion; the one with the largest component is well conditioned.
    d = np.stack([m[..., i, i] for i in range(3)], axis=-1)
    squares = np.stack(
        [
            1.0 + d.sum(-1),
            1.0 + d[..., 0] - d[..., 1] - d[..., 2],
            1.0 - d[..., 0] + d[..., 1] - d[..., 2],
            1.0 - d[..., 0] - d[..., 1] + d[..., 2],
        ],
        axis=-1,
    )
    sums = {
        (0, 1): m[..., 2, 1] - m[..., 1, 2],
        (0, 2): m[..., 0, 2] - m[..., 2, 0],
        (0, 3): m[..., 1, 0] - m[..., 0, 1],
        (1, 2): m[..., 1, 0] + m[..., 0, 1],
        (1, 3): m[..., 0, 2] + m[..., 2, 0],
        (2, 3): m[..., 2, 1] + m[..., 1, 2],
    }
    products = np.empty((*squares.shape, 4))
    for i in range(4):
        products[..., i, i] = squares[..., i]
        for j in range(i + 1, 4):
            products[..., i, j] = products[..., j, i] = sums[i, j]
    best = np.argmax(squares, axis=-1)
    q = np.take_along_axis(products, best[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    if q.ndim == 2 and len(q):
        flips = np.where(np.einsum("ij,ij->i", q[1:], q[:-1]) < 0.0, -1.0, 1.0)
        first = 1.0 if q[0, 0] >= 0.0 else -1.0
        q = q * (first * np.cumprod(np.concatenate([[1.0], flips])))[:, None]
    return np.asarray(q)


def matrix_from_quaternion(q: Floats) -> Floats:
    """ned_from_frd of a unit quaternion, scalar first."""
    w, x, y, z = np.moveaxis(np.asarray(q), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
