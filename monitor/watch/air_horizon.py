"""The long horizon beside the filter bank: its settings as kernels take them, and its decisions."""

import numpy as np
from numpy.typing import NDArray

from estimators.air_data_3d_state import AirParams, AirState
from estimators.air_horizon import HorizonLevels, new_long_horizon
from estimators.air_horizon_judge import conclude, take
from estimators.air_horizon_solve import solve_explanations
from estimators.air_horizon_stage import G_ACTIVE, G_COUNT, G_T, StageLevels
from estimators.air_tests import LONG, put_row
from monitor.settings.air import AirSettings
from monitor.watch.air_horizon_peaks import HorizonPeaks

__all__ = ["Horizon", "horizon_levels", "stage_levels"]

KAPPA, N_KAPPA, N_QP = 0.1, 3, 4
"""Barrier of a window whose bounds act: at its end 0.001 nat a bound, less than any sigma shows."""


def stage_levels(air: AirSettings) -> StageLevels:
    """How epochs become stages; the uncertainty of GPS timing is the filter bank's."""
    s = air.horizon
    return StageLevels(
        stage_s=s.stage_s,
        solve_every=s.solve_stages,
        timing_s=air.timing_s,
        lateral_m_s=s.lateral_m_s,
        common=s.pitot_common,
        own=s.pitot_own,
    )


def horizon_levels(air: AirSettings) -> HorizonLevels:
    """Model, bounds and margins; the bound on the wind is the filter bank's."""
    s = air.horizon
    return HorizonLevels(
        iterations=s.iterations,
        kappa=KAPPA,
        n_kappa=N_KAPPA,
        n_qp=N_QP,
        gust_tau_s=s.gust_tau_s,
        wind_walk_changed=s.wind_walk_changed_m_s,
        scale_walk=s.scale_walk,
        rate_walk=s.rate_walk,
        wind_max_m_s=air.wind_max_m_s,
        down_max_m_s=s.down_max_m_s,
        change_max_m_s=s.change_max_m_s,
        scale_max=s.scale_max,
        margin_one=s.margin_one,
        margin_all=s.margin_all,
        margin_wind=s.margin_wind,
        confirm_s=s.confirm_s,
        min_shift=s.min_shift,
    )


class Horizon:
    """Decides whenever the stream has stopped because stages wait."""

    def __init__(self, air: AirSettings) -> None:
        self._levels = horizon_levels(air)
        self.reached = HorizonPeaks()
        self._solve_every = air.horizon.solve_stages
        self.memory = new_long_horizon(max(round(air.horizon.horizon_s / air.horizon.stage_s), 10))

    def retune(self, air: AirSettings) -> None:
        """Take a new model, bounds and margins; length and stages are those it was made with."""
        self._levels = horizon_levels(air)
        self._solve_every = air.horizon.solve_stages

    def tell(self, state: AirState, tests: NDArray[np.float64], n: int) -> int:
        """Put a verdict's evidence into the rows of tests, at its moment; return their number."""
        t = float(state.stages.memory[G_T])
        if n and tests[n - 1, 0] >= t:
            tests[n - 1, 1:4] = np.fmax(tests[n - 1, 1:4], state.tests[LONG : LONG + 3])
            return n
        put_row(state.tests, t, t, tests[n])
        return n + 1

    def decide(self, state: AirState, params: AirParams, log: NDArray[np.float64]) -> int:
        """Decide if it is time; return the rows written to ``log``."""
        stages, z, levels = state.stages, self.memory, self._levels
        if stages.memory[G_COUNT] < self._solve_every:
            return 0
        explanations = take(stages, z, levels, state.judge)
        if explanations == 0:
            return 0
        solve_explanations(z, levels, explanations)
        self.reached.note(z, levels, int(stages.memory[G_ACTIVE]))
        judge, limits = state.judge, params.limits
        return int(conclude(stages, z, levels, state.bank, judge, limits, log, state.tests))
