"""Autopilots as a component meets them: heartbeats, streams at rates, answers to commands.

Two that behave as ArduPilot and PX4 do, and the ways in which they disappoint: refusing, silent,
accepting without doing so, late, rebooting, obeying somebody else too.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from types import SimpleNamespace

from links.mavlink import Vehicle
from links.mavlink.dialect import load_dialect
from links.mavlink.heard import Heard
from monitor.component.asking import MavCmd, Result
from monitor.component.identity import Identity
from monitor.needs import NEEDS
from monitor.publish import Message
from monitor.settings.component import ComponentSettings

ARDUPILOT, PX4 = 3, 12
DIALECT = load_dialect("ardupilotmega")
US = 191


def number(name: str) -> int:
    return DIALECT.by_name[name].id


def named(n: float) -> str:
    return DIALECT.by_id[int(n)].name


@dataclass
class Autopilot:
    """See the module; ``hz`` are the rates that its messages have, by name."""

    kind: int = ARDUPILOT
    hz: dict[str, float] = field(default_factory=dict)
    system: int = 1
    link: int = 0
    silent: bool = False
    deaf_to: int = 0
    """Commands that it does not hear."""
    refuses: dict[str, Result] = field(default_factory=dict)
    limits: dict[str, float] = field(default_factory=dict)
    """Rate that a message cannot exceed whatever is accepted."""
    fastest_hz: float = 1e9
    """Above it ArduPilot rejects for now."""
    old: bool = False
    """Knows no intervals."""
    busy: int = 0
    """IN_PROGRESS before an answer."""
    fitted: frozenset[str] = frozenset({"imu0", "attitude", "gps0", "nav", "baro0", "servo"})
    blank: frozenset[str] = frozenset()
    bare_acks: bool = False
    """Leaves the target out of its answers."""

    def __post_init__(self) -> None:
        self.default = dict(self.hz)
        self.commands: list[Message] = []
        self.groups: list[Message] = []
        self.t_us = 10_000_000
        self.counts = dict.fromkeys(NEEDS, 0.0)
        self.boots = 0
        self.quiet = False

    @property
    def vehicle(self) -> Vehicle:
        return Vehicle(self.system, self.kind, 1)

    def streams(self) -> dict[str, SimpleNamespace]:
        return {
            name: SimpleNamespace(samples=int(n), last_us=self.t_us, blank=name in self.blank)
            for name, n in self.counts.items()
            if n >= 1
        }

    def fly(self, dt_us: int) -> None:
        self.t_us += dt_us
        for name, need in NEEDS.items():
            if name in self.fitted:
                self.counts[name] += self.rate(need.carrier(self.kind)) * dt_us * 1e-6

    def rate(self, message: str) -> float:
        return min(self.hz.get(message, 0.0), self.limits.get(message, 1e9))

    def reboot(self) -> None:
        self.boots += 1
        self.hz = dict(self.default)

    def says(self, name: str, now_us: int, **fields: object) -> Heard:
        return Heard(name, self.system, 1, self.link, fields, now_us)

    def heartbeat(self, now_us: int) -> Heard:
        return self.says("HEARTBEAT", now_us, autopilot=self.kind, type=1)

    def take(self, message: Message, now_us: int) -> list[Heard]:
        """What it answers."""
        if message.name == "REQUEST_DATA_STREAM":
            self.groups.append(message)
            hz = message.fields["req_message_rate"] * message.fields["start_stop"]
            for need in NEEDS.values():
                if need.group == message.fields["req_stream_id"]:
                    self.hz[need.carrier(self.kind)] = hz
            return []
        if message.name != "COMMAND_LONG":
            return []
        assert message.link == self.link
        assert (message.fields["target_system"], message.fields["target_component"]) == (
            self.system,
            1,
        )
        self.commands.append(message)
        if self.silent or self.deaf_to:
            self.deaf_to = max(self.deaf_to - 1, 0)
            return []
        command, name = message.fields["command"], named(message.fields["param1"])
        out = []
        if self.old:
            return [self.ack(now_us, command, Result.UNSUPPORTED)]
        if command == MavCmd.GET_MESSAGE_INTERVAL:
            hz = self.hz.get(name, 0.0)
            off = 0 if self.kind == PX4 else -1
            interval_us = round(1e6 / hz) if hz else off
            out.append(
                self.says(
                    "MESSAGE_INTERVAL", now_us, message_id=number(name), interval_us=interval_us
                )
            )
            result = Result.ACCEPTED
        else:
            assert command == MavCmd.SET_MESSAGE_INTERVAL
            if self.busy:
                self.busy -= 1
                return [self.ack(now_us, command, Result.IN_PROGRESS)]
            result = self.set(name, message.fields["param2"])
        return [*out, self.ack(now_us, command, result)]

    def set(self, name: str, interval_us: float) -> Result:
        if name in self.refuses:
            return self.refuses[name]
        hz = 1e6 / interval_us if interval_us > 0 else 0.0
        if interval_us == 0:
            hz = self.default.get(name, 0.0)
        if hz > self.fastest_hz:
            return Result.TEMPORARILY_REJECTED
        self.hz[name] = hz
        return Result.ACCEPTED

    def ack(self, now_us: int, command: int, result: Result) -> Heard:
        target = {} if self.bare_acks else {"target_system": self.system, "target_component": US}
        return self.says("COMMAND_ACK", now_us, command=command, result=int(result), **target)


ENOUGH = {
    "RAW_IMU": 50.0,
    "SCALED_IMU": 50.0,
    "ATTITUDE": 20.0,
    "ATTITUDE_QUATERNION": 20.0,
    "GPS_RAW_INT": 5.0,
    "GLOBAL_POSITION_INT": 10.0,
    "SCALED_PRESSURE": 10.0,
    "SERVO_OUTPUT_RAW": 5.0,
    "SYS_STATUS": 2.0,
}
"""Streams of an aircraft that lacks nothing."""

FITTED = frozenset({"imu0", "attitude", "gps0", "nav", "baro0", "airspeed0", "servo", "sys_status"})


def autopilot(kind: int = ARDUPILOT, slow: dict[str, float] | None = None, **how: object):
    """An autopilot of this kind with some streams slow."""
    return Autopilot(kind, ENOUGH | (slow or {}), fitted=FITTED, **how)  # type: ignore[arg-type]


class World:
    """A service before an autopilot: turns of 50 ms, answers come with the next turn."""

    def __init__(self, pilot: Autopilot, settings: ComponentSettings | None = None) -> None:
        self.pilot = pilot
        self.settings = settings or ComponentSettings(listen_s=0)
        self.identity = Identity(self.settings, US, lambda: pilot.vehicle)
        self.now_us = 1_000_000
        self.sent: list[tuple[float, Message]] = []
        self.post: list[Heard] = []
        self.beat_us = 0

    def run(
        self,
        service,
        seconds: float,
        each: Callable[[float], None] = lambda s: None,
    ) -> list[Message]:
        first, until_us = len(self.sent), self.now_us + round(seconds * 1e6)
        while self.now_us < until_us:
            self.now_us += 50_000
            each(self.seconds)
            if not self.pilot.quiet:
                self.pilot.fly(50_000)
                if self.now_us >= self.beat_us:
                    self.beat_us = self.now_us + 1_000_000
                    self.identity.hear(self.pilot.heartbeat(self.now_us), self.now_us)
            self.identity.due(self.now_us)
            out = []
            for heard in self.post:
                if heard.name in service.wants:
                    out += service.hear(heard, self.now_us)
            self.post = []
            out += service.due(self.now_us)
            for message in out:
                self.sent.append((self.seconds, message))
                self.post += self.pilot.take(message, self.now_us)
        return [m for _, m in self.sent[first:]]

    @property
    def seconds(self) -> float:
        return self.now_us / 1e6
