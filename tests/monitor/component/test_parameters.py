"""The parameter protocol: who asks for what, in which order, how often; what it is told."""

from __future__ import annotations

import math
import struct
from collections import Counter
from typing import Any

import pytest
from hypothesis import given
from hypothesis import settings as effort
from hypothesis import strategies as st

from links.mavlink import Vehicle
from links.mavlink.heard import Heard
from monitor.component.identity import Identity
from monitor.component.parameters import AT_ONCE, Parameters
from monitor.component.tunables import RESET, TUNABLES, Refusal, Tunable, Type
from monitor.publish import Message
from monitor.retune import Retuned, value_of
from monitor.settings import PROFILES, Settings, load
from monitor.tuning import Tuning

S = 1_000_000
OURS = (7, 191)
ALL = (*TUNABLES, RESET)
INDEX = {tunable.name: i for i, tunable in enumerate(ALL)}
ARDUPILOT, PX4 = 3, 12


class Station:
    """Asks, and lets time pass."""

    def __init__(self, autopilot: int = ARDUPILOT, flying: bool = False, **component: Any) -> None:
        settings = Settings.model_validate({"component": {"listen_s": 0} | component})
        here = settings.component
        identity = Identity(here, 191, lambda: Vehicle(7, 3, 1), 7)
        self.flying = flying
        self.retunes = 0

        def take(new: Settings) -> Retuned:
            self.retunes += 1
            from monitor.retune import differing

            return Retuned(differing(self.tuning.settings, new))

        self.tuning = Tuning(settings, [take])
        self.parameters = Parameters(here, identity, self.tuning, lambda: self.flying)
        self.now_us = 0
        beat = {"autopilot": autopilot, "type": 1}
        identity.hear(Heard("HEARTBEAT", 7, 1, 0, beat, 0), 0)
        identity.due(0)

    def says(self, name: str, link: int = 0, target: tuple[int, int] = OURS, **fields: Any) -> None:
        fields |= {"target_system": target[0], "target_component": target[1]}
        heard = Heard(name, 255, 190, link, fields, self.now_us)
        assert self.parameters.hear(heard, self.now_us) == []

    def sets(self, name: Any, value: float, kind: int = Type.REAL32, **more: Any) -> None:
        self.says("PARAM_SET", param_id=name, param_value=value, param_type=kind, **more)

    def reads(self, name: Any = "", index: int = -1, **more: Any) -> None:
        self.says("PARAM_REQUEST_READ", param_id=name, param_index=index, **more)

    def gets(self, seconds: float = 3.0) -> list[Message]:
        """PARAM_VALUE of so long, turned fifty times a second."""
        out = []
        for _ in range(round(seconds * 50)):
            self.now_us += S // 50
            out += self.parameters.due(self.now_us)
        return [m for m in out if m.name == "PARAM_VALUE"]

    def told(self, name: str) -> float:
        """The value of the one PARAM_VALUE of this name."""
        (message,) = [m for m in self.gets() if m.fields["param_id"] == name]
        return float(message.fields["param_value"])


def names(messages: list[Message]) -> list[str]:
    return [m.fields["param_id"] for m in messages]


# ---------------------------------------------------------------------------- the table


@pytest.mark.parametrize("tunable", TUNABLES, ids=lambda t: t.name)
def test_every_parameter_is_a_key_of_the_settings_and_its_range_is_allowed(
    tunable: Tunable,
) -> None:
    assert 0 < len(tunable.name) <= 16
    assert tunable.name == tunable.name.upper()
    for profile in PROFILES:
        settings = load(profile)
        value = value_of(settings, tunable.key)
        assert tunable.checked(float(value), settings) == pytest.approx(float(value), rel=1e-6)
        for end in (tunable.least, tunable.most):
            new = tunable.checked(end, settings)
            assert type(new) is type(value)
            nested: Any = new
            for part in reversed(tunable.key.split(".")):
                nested = {part: nested}
            Settings.model_validate(nested)  # the settings allow it too


def test_names_and_keys_are_used_once_and_whole_numbers_survive_a_float() -> None:
    assert len({t.name for t in ALL}) == len({t.key for t in ALL}) == len(ALL)
    assert all(t.most < 1 << 24 for t in ALL)
    for tunable in TUNABLES:
        whole = isinstance(value_of(Settings(), tunable.key), int)
        assert whole == (tunable.type is not Type.REAL32), tunable.name


def test_all_of_them_are_taken_in_flight() -> None:
    from monitor.pipeline import Pipeline
    from monitor.publish import Publisher

    base = Settings()
    tuning = Tuning(base, [Pipeline(base).retune, Publisher(base.publish).retune])
    for tunable in TUNABLES:
        value = value_of(base, tunable.key)
        new = tunable.checked(tunable.most if value != tunable.most else tunable.least, base)
        done = tuning.put({tunable.key: new})
        assert done == Retuned((tunable.key,)), tunable.name
        assert tuning.get(tunable.key) == new


# ---------------------------------------------------------------------------- reading


def test_the_list_is_ours_alone_numbered_and_paced() -> None:
    station = Station()
    station.says("PARAM_REQUEST_LIST", link=2)
    first = station.gets(0.5)
    assert len(first) <= AT_ONCE + 25
    got = first + station.gets(3.0)
    assert names(got) == [t.name for t in ALL]
    assert [m.fields["param_index"] for m in got] == list(range(len(ALL)))
    assert {m.fields["param_count"] for m in got} == {len(ALL)}
    assert {m.link for m in got} == {2}


def test_lists_that_are_asked_for_again_do_not_pile_up_and_nobody_misses_one() -> None:
    station = Station()
    got = []
    for _ in range(200):  # ten times a second, for twenty seconds
        station.says("PARAM_REQUEST_LIST", link=1)
        got += station.gets(0.1)
    assert len(got) <= 20 * 50 + AT_ONCE
    assert min(Counter(names(got)).values()) >= 15  # every request is served by the lap it is in
    after = station.gets(5.0)
    assert len(after) <= len(ALL)
    assert set(names(after)) | set(names(got[-len(ALL) :])) == {t.name for t in ALL}


def test_two_links_share_the_rate_and_single_reads_are_not_starved() -> None:
    station = Station()
    station.says("PARAM_REQUEST_LIST", link=0)
    station.says("PARAM_REQUEST_LIST", link=1)
    station.gets(0.4)
    station.reads("AIR_CONFIRM", link=1)
    got = station.gets(0.2)
    assert "AIR_CONFIRM" in names(got[:2])
    assert abs(Counter(m.link for m in got)[0] - Counter(m.link for m in got)[1]) <= 2
    rest = station.gets(4.0)
    assert {t.name for t in ALL} >= set(names(rest))


def test_one_is_read_by_name_or_by_index() -> None:
    station = Station()
    station.reads("MUTE_AIR")
    (message,) = station.gets()
    assert message.fields["param_index"] == INDEX["MUTE_AIR"]
    assert message.link == 0
    station.reads("MUTE_AIR", index=3)  # the index counts where one is given
    assert names(station.gets()) == [ALL[3].name]
    for name, index in (("", len(ALL)), ("NOT_ONE", -1), ("", -1), ("MUTE_AIR", 20_000)):
        station.reads(name, index)
    assert station.gets() == []


def test_requests_to_others_are_theirs() -> None:
    station = Station()
    for target in ((7, 1), (8, 191), (255, 190)):
        station.says("PARAM_REQUEST_LIST", target=target)
        station.reads("MUTE_AIR", target=target)
        station.sets("MUTE_AIR", 1.0, target=target)
    assert station.gets() == []
    # to all: a list and a name are answered, an index means another parameter to each
    station.reads("MUTE_AIR", target=(7, 0))
    station.reads(index=0, target=(7, 0))
    assert names(station.gets()) == ["MUTE_AIR"]
    station.sets("MUTE_AIR", 1.0, target=(7, 0))
    assert station.gets() == []
    assert station.tuning.own == {}


@pytest.mark.parametrize(
    "padded", [b"AIR_MARGIN_LONE\0", "AIR_MARGIN_LONE", b"AIR_MARGIN_LONE\0junk"]
)
def test_names_end_at_their_end(padded: Any) -> None:
    station = Station()
    station.reads(padded)
    assert names(station.gets()) == ["AIR_MARGIN_LONE"]


def test_names_of_sixteen_characters_need_no_end(monkeypatch: pytest.MonkeyPatch) -> None:
    from monitor.component import parameters

    long = Tunable("SIXTEEN_LETTERS_", "air.confirm_s", Type.REAL32, 0, 10, "s", "")
    monkeypatch.setattr(parameters, "_PARAMETERS", (long,))
    monkeypatch.setattr(parameters, "_INDEX", {long.name: 0})
    station = Station()
    for name in (b"SIXTEEN_LETTERS_", "SIXTEEN_LETTERS_", b"SIXTEEN_LETTERS_X"):
        station.reads(name)
        assert names(station.gets()) == ["SIXTEEN_LETTERS_"]


# ---------------------------------------------------------------------------- writing


def test_a_value_is_taken_told_to_all_and_kept() -> None:
    station = Station()
    station.sets("IMU_ACC_SIZE", struct.unpack("<f", struct.pack("<f", 0.35 * 2))[0], link=1)
    (message,) = station.gets()
    assert message.link is None
    assert message.fields["param_value"] == pytest.approx(0.7)
    assert station.tuning.own == {"imu.acc_size_m_s2": 0.7}  # the decimal number that was meant
    assert "set over MAVLink: IMU_ACC_SIZE" in station.parameters.notes


REFUSED = [
    ("IMU_ACC_SIZE", math.nan, 9, Refusal.NOT_FINITE),
    ("IMU_ACC_SIZE", math.inf, 9, Refusal.NOT_FINITE),
    ("IMU_ACC_SIZE", 1e6, 9, Refusal.RANGE),
    ("IMU_ACC_SIZE", -1.0, 9, Refusal.RANGE),
    ("IMU_ACC_SIZE", 0.5, 0, Refusal.TYPE),
    ("IMU_ACC_SIZE", 0.5, 11, Refusal.TYPE),
    ("MUTE_AIR", 1.5, 3, Refusal.NOT_WHOLE),
    ("MUTE_AIR", 8.0, 3, Refusal.RANGE),  # a bit that is no sensor
    ("MUTE_AIR", -1.0, 3, Refusal.RANGE),
    ("MUTE_AIR", math.nan, 3, Refusal.NOT_FINITE),
    ("MUTE_AIR", -math.inf, 9, Refusal.NOT_FINITE),
    ("PUB_NAMED", 2.0, 1, Refusal.RANGE),
    ("PARAM_RESET", 2.0, 1, Refusal.RANGE),
]


@pytest.mark.parametrize(("name", "value", "kind", "why"), REFUSED)
def test_a_refused_value_is_answered_with_the_one_in_force(
    name: str, value: float, kind: int, why: Refusal
) -> None:
    station = Station()
    before = 0.0 if name == "PARAM_RESET" else float(value_of(Settings(), ALL[INDEX[name]].key))
    station.sets(name, value, kind)
    station.now_us += 1
    said = station.parameters.due(station.now_us)
    assert [m.fields["text"] for m in said if m.name == "STATUSTEXT"] == [
        f"MAVSENTRY: {name}: {why}"
    ]
    (echo,) = [m for m in said if m.name == "PARAM_VALUE"]
    assert echo.fields["param_value"] == pytest.approx(before)
    assert station.tuning.own == {}
    assert station.retunes == 0
    assert station.parameters.refused == {why: 1}


def test_an_unknown_name_has_no_value_to_answer_with() -> None:
    station = Station()
    station.sets("NOT_OF_OURS", 1.0)
    station.sets("\x1b[2J;drop", 1.0)
    texts = [m.fields["text"] for m in station.parameters.due(1)]
    assert texts == [
        "MAVSENTRY: NOT_OF_OURS: no such parameter",
        "MAVSENTRY: ?[2J;drop: no such parameter",
    ]


@pytest.mark.parametrize("flying", [True, False])
def test_what_could_end_the_flight_is_locked_in_flight(flying: bool) -> None:
    station = Station(flying=flying)
    station.sets("FLY_SPEED", 50.0)
    assert station.told("FLY_SPEED") == (9.0 if flying else 50.0)
    station.sets("IMU_LONE_SIG", 9.0)
    assert station.told("IMU_LONE_SIG") == 9.0
    station.flying = True
    station.sets("PARAM_RESET", 1.0)
    assert station.told("PARAM_RESET") == 0.0
    locked = {"phase.flying_speed_m_s": 50.0, "imu.single_sigma": 9.0}
    assert station.tuning.own == ({} if flying else locked)


def test_read_only_and_off() -> None:
    station = Station(parameters="read")
    station.sets("IMU_LONE_SIG", 9.0)
    assert station.told("IMU_LONE_SIG") == 6.0
    assert station.parameters.refused == {Refusal.READ_ONLY: 1}
    station = Station(parameters="off")
    assert station.parameters.wants == frozenset()
    assert station.parameters.capabilities == 0


def test_everything_goes_back_to_the_file_s_values() -> None:
    station = Station()
    station.sets("IMU_LONE_SIG", 9.0)
    station.sets("MUTE_IMU1", 63.0)
    station.gets()
    assert station.parameters.notes[0].startswith("muted by the operator: imu1.acc_x")
    station.sets("PARAM_RESET", 1.0, Type.UINT8)
    told = {m.fields["param_id"]: m.fields["param_value"] for m in station.gets()}
    assert told == {"PARAM_RESET": 0.0, "IMU_LONE_SIG": 6.0, "MUTE_IMU1": 0.0}
    assert station.tuning.own == {}
    assert station.parameters.notes == ()


def test_a_storm_costs_ten_changes_a_second_and_ends_with_the_last_value() -> None:
    station = Station()
    echoes = 0
    for i in range(20_000):
        station.now_us += 50  # 20,000 a second
        station.sets("IMU_LONE_SIG", 4.0 + (i % 1000) / 1000)
        if i % 400 == 0:
            echoes += len(station.parameters.due(station.now_us))
    assert station.retunes <= 11
    assert echoes <= 11
    assert station.told("IMU_LONE_SIG") == pytest.approx(4.999)


# ---------------------------------------------------------------------------- encodings


@pytest.mark.parametrize("autopilot", [PX4, 0, 8])
def test_px4_and_the_rest_send_bytes(autopilot: int) -> None:
    station = Station(autopilot)
    assert station.parameters.capabilities == 1 << 4
    as_bytes = struct.unpack("<f", struct.pack("<I", 0x703))[0]
    station.sets("MUTE_AIR", as_bytes, Type.UINT16)
    (message,) = station.gets()
    assert struct.pack("<f", message.fields["param_value"]) == struct.pack("<I", 0x703)
    assert message.fields["param_type"] == Type.UINT16
    assert station.tuning.own == {"mute.air": 0x703}
    station.sets("MUTE_AIR", as_bytes, Type.REAL32)
    station.sets("MUTE_AIR", as_bytes, Type.UINT32)
    station.sets("IMU_LONE_SIG", 5.0, Type.UINT32)
    assert station.parameters.refused == {Refusal.TYPE: 3}
    station.sets("IMU_LONE_SIG", 5.0, Type.REAL32)
    station.gets()
    assert station.tuning.get("imu.single_sigma") == 5.0


def test_ardupilot_casts_and_heeds_no_type() -> None:
    station = Station(ARDUPILOT)
    assert station.parameters.capabilities == 1 << 17
    for kind in (Type.REAL32, Type.UINT16, 6):
        station.sets("MUTE_AIR", 0, kind)
        station.gets()
        station.sets("MUTE_AIR", float(0x703), kind)
        assert station.told("MUTE_AIR") == 0x703
    as_bytes = struct.unpack("<f", struct.pack("<I", 3))[0]
    station.sets("MUTE_AIR", as_bytes, Type.UINT16)  # a sender that takes us for PX4
    assert station.told("MUTE_AIR") == 0x703


@pytest.mark.parametrize(("said", "bytewise"), [("c-cast", False), ("bytewise", True)])
def test_the_encoding_can_be_configured(said: str, bytewise: bool) -> None:
    for autopilot in (ARDUPILOT, PX4):
        assert Station(autopilot, parameter_encoding=said).parameters.bytewise is bytewise


@given(st.sampled_from(TUNABLES), st.booleans(), st.data())
@effort(max_examples=200, deadline=None)
def test_what_is_sent_can_be_sent_back(t: Tunable, bytewise: bool, data: st.DataObject) -> None:
    settings = Settings()
    if t.type is Type.REAL32:
        number = data.draw(st.floats(t.least, t.most, width=64))
        number = min(max(number, t.least), t.most)
    else:
        number = float(data.draw(st.integers(int(t.least), int(t.most))))
        if t.mask:
            number = float(int(number) & int(t.most))
    value = t.checked(number, settings)
    sent = struct.unpack("<f", struct.pack("<f", t.encode(value, bytewise=bytewise)))[0]
    assert t.decode(sent, int(t.type), bytewise=bytewise, settings=settings) == value


# ---------------------------------------------------------------------------- anything goes

_names = st.one_of(
    st.sampled_from([t.name for t in ALL]), st.binary(max_size=16), st.text(max_size=20)
)
_floats = st.one_of(
    st.floats(width=32),
    st.integers(0, 2**32 - 1).map(lambda n: struct.unpack("<f", struct.pack("<I", n))[0]),
)
_requests = st.one_of(
    st.tuples(st.just("list"), st.integers(0, 3)),
    st.tuples(st.just("read"), _names, st.integers(-32768, 32767)),
    st.tuples(st.just("set"), _names, _floats, st.integers(0, 255)),
    st.tuples(st.just("wait"), st.integers(0, 300)),
)


@given(st.lists(_requests, max_size=60), st.sampled_from([ARDUPILOT, PX4]), st.booleans())
@effort(max_examples=150, deadline=None)
def test_no_order_of_requests_breaks_it(
    requests: list[tuple[Any, ...]], autopilot: int, flying: bool
) -> None:
    station = Station(autopilot, flying)
    sent: list[Message] = []
    lists = 0
    for kind, *rest in requests:
        match kind:
            case "list":
                station.says("PARAM_REQUEST_LIST", link=rest[0])
                lists += 1
            case "read":
                station.reads(*rest)
            case "set":
                station.sets(*rest)
            case _:
                sent += station.gets(rest[0] / 1000)
    sent += station.gets(12.0)
    assert station.gets(2.0) == []  # all that was owed is paid
    assert len(sent) <= 2 * len(requests) + lists * len(ALL) + len(ALL)
    settings = Settings.model_validate(station.tuning.settings.model_dump())
    newest: dict[str, float] = {}
    for message in sent:
        tunable = ALL[message.fields["param_index"]]
        assert message.fields["param_id"] == tunable.name
        assert message.fields["param_type"] == tunable.type
        newest[tunable.name] = message.fields["param_value"]
    for tunable in TUNABLES:  # what was said last of each is what is in force
        value = value_of(settings, tunable.key)
        assert tunable.checked(float(value), settings) == value
        if tunable.key in station.tuning.own:
            assert tunable.name in newest
        if tunable.name in newest:
            assert newest[tunable.name] == tunable.encode(
                value, bytewise=station.parameters.bytewise
            )


@given(st.lists(st.booleans(), min_size=300, max_size=300))
@effort(max_examples=30, deadline=None)
def test_a_reader_that_loses_frames_gets_all_by_asking_for_the_missing(lost: list[bool]) -> None:
    """As ground stations do: the list once, then what is missing by index, at most so often."""
    station, chance = Station(), iter(lost)
    station.says("PARAM_REQUEST_LIST")
    have: set[int] = set()
    for _ in range(40):
        have |= {m.fields["param_index"] for m in station.gets(2.0) if not next(chance, False)}
        missing = set(range(len(ALL))) - have
        if not missing:
            return
        for index in sorted(missing):
            if not next(chance, False):
                station.reads(index=index)
    pytest.fail(f"never got {missing}")
