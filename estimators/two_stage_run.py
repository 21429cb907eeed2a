"""Adaptive two-stage EKF: whole arrays of inputs and measurements without returning to Python.

Symbols as in :mod:`estimators.two_stage_memory`.
"""

from __future__ import annotations

from estimators.jit import kernel
from estimators.kinematics import earth_terms
from estimators.linalg import matmul
from estimators.two_stage_memory import LATE, OK, WAITING, Array, Ints, Row
from estimators.two_stage_predict import predict
from estimators.two_stage_update import update

__all__ = ["predict_once", "run_fixed_rate", "run_rows", "update_once"]


@kernel
def record(s: Row, out: Row, status: int) -> None:
    """Write the present estimates into a row of TRACK; the state's variance is (52)'s diagonal."""
    matmul(s.V, s.Pf, s.A)
    for i in range(6):
        variance = s.P[i, i]
        for j in range(6):
            variance += s.A[i, j] * s.V[i, j]
        out.f[i] = s.f[i]
        out.f_var[i] = s.Pf[i, i]
        out.x[i] = s.x[i]
        out.x_var[i] = variance
        out.Qf[i] = s.Qf[i]
        out.gamma[i] = s.gamma[i]
    out.nis = s.nis
    out.status = status


@kernel
def predict_once(
    memory: Row, tuning: Row, um: Array, latitude_rad: float, altitude_m: float, dt: float
) -> int:
    """:func:`predict` for a caller outside the kernels."""
    return predict(memory[0], tuning[0], um, earth_terms(latitude_rad, altitude_m), dt)


@kernel
def update_once(memory: Row, tuning: Row, y: Array) -> int:
    """:func:`update` for a caller outside the kernels."""
    return update(memory[0], tuning[0], y)


@kernel
def run_fixed_rate(
    memory: Row, tuning: Row, um: Array, y: Array, env: Array, dt: float, out: Row
) -> None:
    """Predict with ``um[k], env[k]``, update with ``y[k]``, record in ``out[k]``, row after row."""
    s, t = memory[0], tuning[0]
    for k in range(um.shape[0]):
        predicted = predict(s, t, um[k], earth_terms(env[k, 0], env[k, 1]), dt)
        updated = update(s, t, y[k])
        record(s, out[k], max(predicted, updated))


@kernel
def run_rows(
    memory: Row,
    tuning: Row,
    imu_t_us: Ints,
    um: Array,
    meas_t_us: Ints,
    y: Array,
    env: Array,
    until_us: int,
    out: Row,
) -> tuple[int, int]:
    """Use inputs and measurements in the order of their times, up to and including ``until_us``.

    An input holds from its time to the next input's; a measurement inside that interval splits it.
    Rows must be sorted by time within each array. One row of `out` per measurement used.

    Returns
    -------
    inputs, measurements : int
        How many rows of each were consumed, late ones included.
    """
    s, t = memory[0], tuning[0]
    earth = earth_terms(env[0], env[1])
    i, m = 0, 0
    while True:
        next_imu = imu_t_us[i] if i < imu_t_us.shape[0] else until_us + 1
        next_meas = meas_t_us[m] if m < meas_t_us.shape[0] else until_us + 1
        at = min(next_imu, next_meas)
        if at > until_us:
            return i, m
        late = s.started and at < s.now_us
        status = OK if s.started else WAITING
        if not late:
            if s.started:
                status = predict(s, t, s.um, earth, (at - s.now_us) * 1e-6)
            s.now_us = at
        if next_meas <= next_imu:
            if late:
                status = LATE
            elif s.started:
                status = max(status, update(s, t, y[m]))
            record(s, out[m], status)
            m += 1
        else:
            if not late:
                s.started = True
                predict(s, t, um[i], earth, 0.0)
            i += 1
