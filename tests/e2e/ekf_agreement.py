"""How well our model of EKF3's airspeed test follows the EKF on board, flight by flight.

    python -m tests.e2e.ekf_agreement FLIGHT.tlog...

EKF_STATUS_REPORT carries, four times a second, the square root of EKF3's airspeed test ratio: the
innovation over four of its standard deviations. It is no input of anything here; this prints it
beside the same quantity of :class:`estimators.baselines.ardupilot.ArduPilotAirspeed`.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from pymavlink import mavutil

from estimators.baselines import ardupilot
from links.logs import open_log
from links.samples import Rows
from monitor.baselines import BaselineTap
from monitor.pipeline import Pipeline
from monitor.settings import Settings

GATE_SIGMA = 4.0
LATENCY_US = 100_000
SETTLED_S = 60.0


class Model(BaselineTap):
    """The tap, which also keeps the rows."""

    def __init__(self) -> None:
        super().__init__()
        self.rows: list[dict[str, Rows]] = []

    def step(self, rows: dict[str, Rows]) -> None:  # type: ignore[override]
        self.rows.append(rows)

    def ratios(self, at_us: np.ndarray) -> np.ndarray:
        """|innovation| over four standard deviations at these times, NaN before there is wind."""
        together: dict[str, list[Rows]] = {}
        for part in self.rows:
            for sensor, rows in part.items():
                together.setdefault(sensor, []).append(rows)
        events = self.air_events({s: np.concatenate(r) for s, r in together.items()})
        assert events is not None
        t, kind, value = events
        check, out, done = ardupilot.ArduPilotAirspeed({"ARSPD_OPTIONS": 3.0}), [], 0
        for t_us in at_us:
            until = int(np.searchsorted(t, t_us - LATENCY_US, "right"))
            check.step(t[done:until], kind[done:until], value[done:until])
            done = until
            nu, S = check.state[ardupilot.NU], check.state[ardupilot.S_NU]
            out.append(abs(nu) / np.sqrt(S) / GATE_SIGMA if S > 0.0 else np.nan)
        return np.array(out)


def on_board(path: Path) -> np.ndarray:
    """(n, 2): time [us] and the square root of the airspeed test ratio that the autopilot sent."""
    log, t_us, out = mavutil.mavlink_connection(str(path)), 0, []
    while (m := log.recv_match(type=["ATTITUDE", "EKF_STATUS_REPORT"])) is not None:
        if m.get_type() == "ATTITUDE":
            t_us = m.time_boot_ms * 1000
        else:
            out.append((t_us, m.airspeed_variance))
    return np.array(out)


def main() -> None:
    print(f"{'flight':28s} {'rms model':>9s} {'on board':>9s} {'correlation':>11s}")
    for name in sys.argv[1:]:
        path, model = Path(name), Model()
        pipeline = Pipeline(Settings(), watches=[], taps=[model])
        for batch in open_log(path):
            pipeline.feed(batch)
        pipeline.finish()
        sent = on_board(path)
        ours = model.ratios(sent[:, 0])
        use = np.isfinite(ours) & (sent[:, 0] > SETTLED_S * 1e6)
        a, b = ours[use], sent[use, 1]
        rms = [float(np.sqrt(np.mean(x**2))) for x in (a, b)]
        print(f"{path.stem:28s} {rms[0]:9.2f} {rms[1]:9.2f} {np.corrcoef(a, b)[0, 1]:11.2f}")


if __name__ == "__main__":
    main()
