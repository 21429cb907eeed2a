"""State and tuning of the filter bank, as flat arrays: what every kernel of it reads and writes.

==========  =========================================================  ======
symbol      meaning                                                    number
==========  =========================================================  ======
I           IMUs
C           filters: IMU i has the filters 2 i (INS) and 2 i + 1 (ATT)  2 I
W           windows of each filter: two, half a length apart, for each
            length; the last one is started on demand
tick        end of an interval of the grid on which decisions are made
==========  =========================================================  ======
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.imu_difference import EDGES, PAIR_ROWS
from estimators.ins_bank_model import COLUMNS, MAX_WINDOWS, N_ACC, N
from estimators.ins_bank_turns import TURNS

__all__ = [
    "EVENT_WIDTH",
    "MAX_IMUS",
    "N_RATIOS",
    "PENDING",
    "TICK_WIDTH",
    "Bank",
    "Tuning",
    "make_bank",
]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

MAX_IMUS = 5
GPS, BARO, ATTITUDE, PHASE = 5, 6, 7, 8
"""Kind of an event; 0..4 are samples of that IMU."""

EVENT_WIDTH = 8
"""Columns of an event's values.

IMU: acc xyz, gyro xyz [m/s^2, rad/s]. GPS: vel N, E, D (NaN when unknown) [m/s], latitude [rad],
height [m], longitude [rad], velocity std [m/s]. BARO: pressure height [m]. ATTITUDE: quaternion
ned_from_frd. PHASE: 1 when flying begins, 0 when it ends. A GPS event whose velocity N is NaN says
that the receiver has no fix.
"""

N_RATIOS = 7
TICK_WIDTH = 19 + N_RATIOS
"""Columns of an IMU's row of a tick: time, six faults, their variances, the sample, the ratios."""

PENDING = 64
"""Measurements that may wait for an IMU's next sample; an IMU further behind has stopped."""


class Tuning(NamedTuple):
    """Numbers of the filters, as arrays and scalars that a kernel reads (see ``ImuSettings``)."""

    noise_density: Array  # (6,) m/s^1.5, rad/s^0.5: lower bound of the input noise
    scale_error: Array  # (6,) 1: of the true input, as noise correlated over one second
    fault_density: Array  # (6,) m/s^2.5, rad/s^1.5: random walk of the slow biases
    turn_on_std: Array  # (6,) m/s^2, rad/s: biases at the start
    ref_std: Array  # (2, 4) rad, m/s, m: reference errors of mode INS, mode ATT
    ref_tau: Array  # (2, 4) s
    gps_std_m_s: float
    gps_down_std_m_s: float
    baro_std_m: float
    tilt_std_rad: float
    heading_std_rad: float
    slip_std_rad: float
    gust_std_m_s: float
    window_s: Array  # (W/2,) s: lengths of the windows
    tick_s: float
    max_rate_rad_s: float
    interest_sigma: float  # a statistic beyond this is handed to the caller
    interest_size: Array  # (6,) m/s^2, rad/s: and an estimate beyond this
    difference_sigma: float  # an alarm of two IMUs' difference
    single_sigma: float  # an alarm of a lone IMU's window
    noise_ln: float  # an alarm of an axis' noise over its peers', as a logarithm
    attitude_independent: bool  # the vehicle's attitude does not share the IMU's faults


class Bank(NamedTuple):
    """State of all filters; every array is C-contiguous and changed in place."""

    x: Array  # (C, 17)
    R: Array  # (C, 3, 3)
    P: Array  # (C, 17, 17)
    acc: Array  # (C, 28)
    qf: Array  # (C, 6) density of the fault walk, squared; raised on an axis found faulty
    F: Array  # (C, 17, 66) of each window six columns, see columns_of
    L: Array  # (C, W, 6, 6)
    Y: Array  # (C, W, 6)
    start_s: Array  # (C, W) start of each window
    start_nis: Array  # (C, W) normaliser when it started
    swing: Array  # (C, 2, 6) mean z^2 and fault^2 over the last short windows, see ins_bank_windows
    nis: Array  # (C,) running mean of the normalised innovation squared
    aligned_s: Array  # (C,) time of alignment, NaN before
    fix: Array  # (C, 6) last residual N, E; its last change between fixes; times of a jolt, a fix
    slip_s: Array  # (C,) time of the last slip measurement
    sample: Array  # (I, 7) last sample of each IMU: time, values; time NaN before the first
    diff2: Array  # (I, 6) mean square of the first difference over 2 s
    turn: Array  # (I, 3) rates, smoothed
    alias: Array  # (I, 6) the same times the sampling interval
    ref: Array  # (16,) last reference values, see R_* below
    pend: Array  # (PENDING, 2 + EVENT_WIDTH) waiting measurements: time, kind, values
    pend_read: Ints  # (I + 1,) next to read of each IMU; last: pushed so far
    edge: Array  # (I, EDGES, 6) integrals of each IMU at the edges of the grid
    edge_at: Ints  # (I, EDGES) which edge each slot holds, -1 none
    usual_s: Array  # (I,) usual time between samples [s]
    integral: Array  # (I, 6) running integral of each IMU
    pair: Array  # (I, I, PAIR_ROWS, 6) difference tests, see imu_difference
    heading: Array  # (I, 2) jumps of the attitude's heading, see ins_bank_turns
    turns: Array  # (I, TURNS, 11) attitude increments against the gyro, see ins_bank_turns
    noise: Array  # (I, 8, 6) noise and stuck tests, see imu_difference
    called: Array  # (I, 6) 1: a fault is called on that axis (the caller says so)
    ratios: Array  # (I, 7) statistic over threshold of the last tick, see ins_bank_tests
    peaks: Array  # (5,) largest healthy values of what is compared, see ins_bank_interest
    clock: Array  # (19,) see C_* below

    @property
    def last_window(self) -> int:
        """The window that is started on demand."""
        return int(self.start_s.shape[1]) - 1


R_T_GPS, R_VN, R_VE, R_VD, R_LAT, R_ALT, R_LON, R_T_BARO, R_HGT, R_T_ATT, R_Q = range(11)
"""Columns of ``Bank.ref``: when each reference was last seen [s] and what it said."""

C_FLYING, C_TICK, C_NOW, C_GRAVITY, C_POS_N, C_POS_E, C_POS_T, C_GPS_BAD_S = range(8)
C_CHANGED, C_SPIN_S, C_STOPPED, C_FIX_S, C_POS_M, C_JUDGED = range(8, 14)
C_COS_LAT, C_SIN_LAT, C_TAN_LAT, C_HOLE_S, C_NO_FIX_S = range(14, 19)
"""Columns of ``Bank.clock``: flying flag, last closed tick, time of the last event, local gravity;
receiver position minus integrated receiver velocity over the last interval and its start;
time until which the receiver contradicts itself; whether something changed that the caller must
know; when the aircraft last turned too fast; whether :func:`run` stopped at a tick;
usual interval of fixes; distance flown over that interval; whether every IMU is judged and none is
called faulty (the caller says so); functions of the latitude."""


def make_bank(n_imus: int, tuning: Tuning) -> Bank:
    """Bank for IMUs 0..n_imus-1, before the first event."""
    n, w = 2 * n_imus, 2 * len(tuning.window_s) + 1
    if w > MAX_WINDOWS:
        raise ValueError(f"{len(tuning.window_s)} lengths of windows: at most {MAX_WINDOWS // 2}")
    nan = np.nan
    clock = np.zeros(19)
    clock[[C_NOW, C_POS_T]] = nan
    clock[[C_GPS_BAD_S, C_SPIN_S, C_HOLE_S, C_NO_FIX_S]] = -1e9
    clock[C_TICK], clock[C_GRAVITY], clock[C_FIX_S], clock[C_COS_LAT] = -1.0, 9.80665, 0.2, 1.0
    return Bank(
        x=np.zeros((n, N)),
        R=np.tile(np.eye(3), (n, 1, 1)),
        P=np.zeros((n, N, N)),
        acc=np.zeros((n, N_ACC)),
        qf=np.tile(tuning.fault_density**2, (n, 1)),
        F=np.zeros((n, N, COLUMNS)),
        L=np.zeros((n, w, 6, 6)),
        Y=np.zeros((n, w, 6)),
        start_s=np.full((n, w), nan),
        start_nis=np.ones((n, w)),
        swing=np.zeros((n, 2, 6)),
        nis=np.full(n, 1.0),
        aligned_s=np.full(n, nan),
        fix=np.tile([0.0, 0.0, nan, nan, -1e9, -1e9], (n, 1)),
        slip_s=np.full(n, -1e9),
        sample=np.full((n_imus, 7), nan),
        diff2=np.zeros((n_imus, 6)),
        turn=np.zeros((n_imus, 3)),
        alias=np.zeros((n_imus, 6)),
        ref=np.full(16, nan),
        pend=np.zeros((PENDING, 2 + EVENT_WIDTH)),
        pend_read=np.zeros(n_imus + 1, dtype=np.int64),
        edge=np.zeros((n_imus, EDGES, 6)),
        edge_at=np.full((n_imus, EDGES), -1, dtype=np.int64),
        usual_s=np.zeros(n_imus),
        integral=np.zeros((n_imus, 6)),
        pair=np.zeros((n_imus, n_imus, PAIR_ROWS, 6)),
        heading=np.tile([0.0, -1e9], (n_imus, 1)),
        turns=np.full((n_imus, TURNS, 11), nan),
        noise=np.zeros((n_imus, 8, 6)),
        called=np.zeros((n_imus, 6)),
        ratios=np.full((n_imus, N_RATIOS), nan),
        peaks=np.zeros(5),
        clock=clock,
    )
