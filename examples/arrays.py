"""Feed the monitor numpy arrays: no MAVLink, no files, no autopilot.

A small aircraft circles in a wind of 6 m/s. After four minutes its pitot begins to ice: it
reads less and less. The arrays could as well come from a simulation, a CSV
file or another kind of log.
"""

import numpy as np

from monitor import ArraySource, Monitor, State, Verdict, load_settings

SPEED_M_S = 20.0
WIND_NED_M_S = np.array([5.0, -3.3, 0.0])
ONSET_S = 240.0
G0_M_S2 = 9.80665


def flight(duration_s: float = 400.0) -> dict[str, dict[str, np.ndarray]]:
    """Sensor -> field -> array, as the instruments of such an aircraft deliver them."""
    random = np.random.default_rng(1)
    t_s = np.arange(0.2, duration_s, 0.2)
    yaw_rate_rad_s = 2.0 * np.pi / 40.0
    yaw_rad, bank_rad = yaw_rate_rad_s * t_s, np.arctan(SPEED_M_S * yaw_rate_rad_s / G0_M_S2)

    forward = np.column_stack((np.cos(yaw_rad), np.sin(yaw_rad), np.zeros_like(t_s)))
    vel_ned_m_s = SPEED_M_S * forward + WIND_NED_M_S
    height_m = np.full_like(t_s, 200.0)
    c, s = np.cos(yaw_rad / 2), np.sin(yaw_rad / 2)
    cb, sb = np.cos(bank_rad / 2), np.sin(bank_rad / 2)

    cas_m_s = SPEED_M_S * np.sqrt(0.98) + 0.2 * random.standard_normal(len(t_s))
    cas_m_s *= 1.0 - 0.01 * np.clip(t_s - ONSET_S, 0.0, 60.0)  # one percent a second
    return {
        "attitude": {
            "t_s": t_s,
            "q_ned_from_frd": np.column_stack((c * cb, c * sb, s * sb, s * cb)),
        },
        "gps0": {
            "t_s": t_s,
            "vel_ned_m_s": vel_ned_m_s + 0.1 * random.standard_normal(vel_ned_m_s.shape),
            "alt_m": height_m,
        },
        "baro0": {
            "t_s": t_s,
            "static_press_pa": np.full_like(t_s, 98_945.0),
            "temperature_k": np.full_like(t_s, 286.85),
        },
        "airspeed0": {"t_s": t_s, "cas_m_s": cas_m_s},
    }


def main() -> list[Verdict]:
    sentry = Monitor(load_settings("small-uav"))
    batch = ArraySource().batch(flight())  # or a piece at a time, as it comes
    verdicts = [*sentry.feed(batch).verdicts, *sentry.finish().verdicts]
    for v in verdicts:
        said = v.evidence if v.state is State.FAULTY else v.reason or ""
        print(f"{v.t_us / 1e6:6.1f} s  {v.sensor:10}  {v.state:12}  {said}")
    return verdicts


if __name__ == "__main__":
    main()
