"""What goes over the WebSocket ``/live``: messages in JSON, each with a ``kind``.

A viewer that connects gets one ``hello``, then ``history`` messages with the frames of the last
minutes (oldest first, the last of them says ``last``), then a ``frame`` a few times a second. A
``hello`` may come again at any time (the web process had to begin anew): it replaces all that was
said before of states, faults, streams and link; the frames already seen stay valid while ``run``
is the same, and those that come again are told by their ``number``. A viewer says nothing.

==================  =============================================================================
times ``*t_s``      vehicle time in seconds, the clock of the vehicle; null before it is known
``*_unix_s``        Unix time in seconds
angles, rates       degrees, deg/s; all else SI, the unit in the name, in ``unit`` or ``channels``
                    (as people read it: ``m/s²``, ``deg``, ``deg/s``)
missing numbers     null (JSON has no NaN); a key that may be missing is ``NotRequired``: nothing
                    new is said of it, what was said last stands
==================  =============================================================================

Closing: 1001 the daemon stops, 1013 too many viewers (the reason is a sentence), 1008 not allowed.
A viewer that is closed, or loses its connection, connects again after a while.
"""

from __future__ import annotations

from typing import Final, Literal, NotRequired, TypedDict

__all__ = [
    "PROTOCOL",
    "Air",
    "Engine",
    "Event",
    "Fault",
    "Frame",
    "Hello",
    "History",
    "Imu",
    "Latency",
    "Link",
    "Message",
    "Process",
    "Range",
    "Recorder",
    "Standing",
    "Stream",
    "Wing",
]

PROTOCOL: Final = 1
"""Raised when a message changes so that an older page would misread it."""

Number = float | None
"""A finite number, or null."""

Vector = list[Number]
"""Three numbers: x, y, z of the body or north, east, down."""

Range = tuple[float, float]
"""Smallest and largest value since the frame before; the same twice of a single one."""


class Standing(TypedDict):
    """A state of a sensor, and since when it stands.

    Attributes
    ----------
    t_s
        When it was decided; it stands until the next one.
    state
        ``ok suspect faulty stale absent unmonitored stopped`` (links.vocabulary.State).
    reason
        Why it is unmonitored.
    kind, size
        Of a fault: its shape (links.vocabulary.Kind), and how large in words, ``3.1 m/s low``.
    onset_t_s
        Of a fault: when it began.
    evidence
        One sentence, may be empty.
    """

    t_s: float
    state: str
    reason: str | None
    kind: str | None
    size: str | None
    onset_t_s: float | None
    evidence: str


class Fault(TypedDict):
    """A fault, as in summary.json but in vehicle time; ``number`` tells it from all others.

    ``detected_t_s``: something was said to be wrong; ``isolated_t_s``: this sensor was named;
    ``cleared_t_s``: it is ok again. ``magnitude`` is in ``unit``, angles in degrees.
    """

    number: int
    sensor: str
    kind: str
    size: str
    onset_t_s: float
    detected_t_s: float
    isolated_t_s: float
    cleared_t_s: float | None
    magnitude: Number
    unit: str
    statistic: Number
    threshold: Number
    estimator: str
    evidence: str


class Event(TypedDict):
    """What happened to the aircraft itself: an engine that stopped, no sensor being at fault."""

    number: int
    what: str
    state: str
    onset_t_s: float
    detected_t_s: float
    ended_t_s: float | None
    evidence: str


class Stream(TypedDict):
    """A stream of samples: rate over the last second of the host's clock, counts since the start.

    ``gaps``: intervals longer than its time-out. ``stale``: it has stopped.
    """

    rate_hz: float
    samples: int
    gaps: int
    stale: bool


class Link(TypedDict):
    """The vehicle's link.

    Attributes
    ----------
    silent, silent_s
        Nothing of the vehicle for the configured time; for how long there was nothing (null:
        nothing was ever heard).
    datagrams, datagrams_s, rows_s
        Datagrams since the start; datagrams and samples per second.
    bytes, bad_bytes, lost
        Since the start: bytes received, those that belong to no frame, and frames that are missing
        from the sequence numbers.
    sent
        Messages published since the start.
    """

    silent: bool
    silent_s: Number
    datagrams: int
    datagrams_s: float
    rows_s: float
    bytes: int
    bad_bytes: int
    lost: int
    sent: int


class Latency(TypedDict):
    """From the arrival of a datagram to our answer; over the newest answers, ``count`` of all."""

    count: int
    median_ms: Number
    p99_ms: Number
    worst_ms: Number


class Recorder(TypedDict):
    """What is recorded: the file's name, its bytes, those of all files of this start.

    ``stopped`` says in a sentence why nothing is recorded any more; null while it is.
    """

    file: str
    file_bytes: int
    bytes: int
    stopped: str | None


class Process(TypedDict):
    """The daemon's own cost: processor time since its start, memory that it holds now.

    ``snapshot_ms`` is processor time that a frame took, the mean of the last second.
    ``dropped``: frames that the web process did not take in time.
    """

    cpu_s: float
    memory_mb: Number
    snapshot_ms: Number
    dropped: int


class Air(TypedDict):
    """Estimated air data; ``*_std`` is one standard deviation. Null where not observable.

    The wind is the velocity that the air moves toward: north, east, down.
    """

    t_s: float
    cas_m_s: Number
    cas_std_m_s: Number
    tas_m_s: Number
    tas_std_m_s: Number
    aoa_deg: Number
    aoa_std_deg: Number
    ssa_deg: Number
    ssa_std_deg: Number
    wind_ned_m_s: Vector
    wind_std_ned_m_s: Vector


class Imu(TypedDict):
    """Estimated fault of each axis of one IMU: x, y, z of the body."""

    t_s: float
    acc_fault_m_s2: Vector
    acc_fault_std_m_s2: Vector
    gyro_fault_deg_s: Vector
    gyro_fault_std_deg_s: Vector


class Engine(TypedDict):
    """Reconstructed shaft speeds, spool0 first; null for those that no model speaks for."""

    t_s: float
    speed_rpm: list[Number]
    speed_std_rpm: list[Number]
    throttle: Number
    climb_power_m_s: Number


class Wing(TypedDict):
    """Lift lost and drag gained by each wing."""

    t_s: float
    left_lift_percent: Number
    left_lift_std_percent: Number
    left_drag_percent: Number
    left_drag_std_percent: Number
    right_lift_percent: Number
    right_lift_std_percent: Number
    right_drag_percent: Number
    right_drag_std_percent: Number


class _Seldom(TypedDict):
    """What seldom changes: in ``hello`` as it stands, in a frame when it is new.

    ``streams``, ``latency``, ``recorder`` and ``process`` are renewed about once a second;
    ``rejected`` (sensor or ``frame`` -> reason -> count since the start) and ``channels`` (name in
    ``measured`` -> unit) on change, whole. ``recorder`` is null when nothing is recorded.
    """

    streams: NotRequired[dict[str, Stream]]
    latency: NotRequired[Latency]
    recorder: NotRequired[Recorder | None]
    process: NotRequired[Process]
    rejected: NotRequired[dict[str, dict[str, int]]]
    channels: NotRequired[dict[str, str]]


class Hello(_Seldom):
    """The whole of what stands now.

    Attributes
    ----------
    run
        Another one after a restart of the daemon: all that was shown before is of another flight.
    source, profile, version
        The link that is listened to, the settings' profile, mavsentry's version.
    started_unix_s
        Start of the daemon.
    rate_hz, history_s
        Frames per second, and for how long back they are kept.
    number
        Of the newest frame so far; history goes up to it. -1 before the first.
    timeline
        Sensor -> its states over the history, oldest first; the last one stands now, the first one
        may have begun before. Of changes in history frames nothing else need be used.
    faults, events
        So far, the newest hundred of each, oldest first.
    """

    kind: Literal["hello"]
    protocol: int
    run: str
    source: str
    profile: str
    version: str
    started_unix_s: float
    rate_hz: float
    history_s: float
    number: int
    t_s: float | None
    flying: bool
    link: Link | None
    timeline: dict[str, list[Standing]]
    faults: list[Fault]
    events: list[Event]


class Frame(_Seldom):
    """What is new since the frame before.

    Attributes
    ----------
    number
        Counts up from 0; what is missing was dropped for a viewer that was slow.
    unix_s
        When it was made.
    t_s
        Vehicle time up to which everything is judged; stands still while the link is silent.
    flying
        Sensors are judged in flight only.
    changes
        Sensor -> its new states, oldest first.
    faults, events
        Those that are new or have changed, by ``number``.
    measured
        Channel -> range of what was measured. ``imu0.acc_x`` ... ``imu0.gyro_z``, ``airspeed0``,
        ``aoa0``, ``spool0``, ``gps0.speed``, ``altitude``, ``roll``, ``pitch`` ...; units are in
        ``channels``.
    tests
        Sensor -> largest test statistic over its threshold; 1 is the threshold. ``imu0.blame``:
        how clear it is that a dispute between IMUs is this one's fault.
    air, imu, engine, wing
        The newest estimate, if there is a newer one; ``imu`` by the name of the IMU.
    expected
        Pitot or vane -> what it should show now and its standard deviation, in the unit of its
        channel; those of which it is known.
    """

    kind: Literal["frame"]
    number: int
    unix_s: float
    t_s: float | None
    flying: bool
    link: Link
    changes: NotRequired[dict[str, list[Standing]]]
    faults: NotRequired[list[Fault]]
    events: NotRequired[list[Event]]
    measured: NotRequired[dict[str, Range]]
    tests: NotRequired[dict[str, float]]
    air: NotRequired[Air]
    imu: NotRequired[dict[str, Imu]]
    engine: NotRequired[Engine]
    wing: NotRequired[Wing]
    expected: NotRequired[dict[str, tuple[float, Number]]]


class History(TypedDict):
    """Some of the frames before ``hello``, oldest first; ``last`` when no more follow."""

    kind: Literal["history"]
    last: bool
    frames: list[Frame]


Message = Hello | History | Frame
