"""The monitor inside a program of one's own: MAVLink from a UDP port, one line a change of state.

python embed.py            listens on 127.0.0.1:14550 until nothing has come for 10 s
python embed.py 14551 60   another port, and 60 s
"""

import socket
import sys

from monitor import Monitor, State, StepResult, load_settings, warm_up


def tell(result: StepResult) -> None:
    for verdict in result.verdicts:
        why = verdict.evidence if verdict.state is State.FAULTY else verdict.reason or ""
        print(f"{verdict.t_us / 1e6:8.1f} s  {verdict.sensor:12} {verdict.state:12} {why}")
    for air in result.estimates.get("air", ()):  # the true values, for whoever needs them
        _ = air["t_us"], air["tas_m_s"], air["wind_ned_m_s"]


def main(port: int = 14550, silent_s: float = 10.0) -> None:
    settings = load_settings("small-uav")  # or load_settings(file=Path("sentry.toml"))
    warm_up(settings)  # before the first datagram waits
    sentry = Monitor(settings)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.bind(("127.0.0.1", port))
        link.settimeout(silent_s)
        print(f"listening on port {port}", flush=True)
        while True:
            try:
                datagram = link.recv(65_535)
            except TimeoutError:
                break
            tell(sentry.feed(datagram))
    tell(sentry.finish())


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:3]))
