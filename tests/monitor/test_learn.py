"""Rules of learning, on flights whose peaks are given."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from links.mavlink.options import Vehicle
from links.samples import empty_rows
from links.vocabulary import State
from monitor import learn as package
from monitor import settings as configuration
from monitor.learn import (
    Alarm,
    Calibration,
    Flight,
    Learnt,
    Outcome,
    TooLittle,
    Trial,
    Unfit,
    document,
    flagged_by_the_others,
    learn,
)
from monitor.learn.fit import check_alike, check_healthy
from monitor.learn.levels import LevelMeter
from monitor.learn.provenance import FROM_THIS_FLIGHT, provenance
from monitor.learn.rules import RULES, Kind
from monitor.learn.thresholds import (
    default_of,
    raised_levels,
    widened,
)
from monitor.settings import Settings
from monitor.settings.learnt import LearntLog, LearntSettings

DEFAULTS = configuration.load()
AXES = ("acc_x", "acc_y", "acc_z", "gyro_x", "gyro_y", "gyro_z")
PLANE = Vehicle(1, 3, 1)


def flight(
    name: str = "a.tlog",
    peaks: Mapping[str, float] | None = None,
    minutes: float = 5.0,
    imus: int = 2,
    pitots: int = 2,
    **more: object,
) -> Flight:
    """A flight that judged all its sensors for so many minutes."""
    sensors = [f"imu{i}.{axis}" for i in range(imus) for axis in AXES]
    sensors += [f"airspeed{i}" for i in range(pitots)]
    given: dict[str, object] = {
        "name": name,
        "settings": DEFAULTS,
        "seconds": 60.0 * minutes,
        "judged_s": dict.fromkeys(sensors, 60.0 * minutes),
        "peaks": peaks or {},
        "sha256": f"{abs(hash(name)):064x}"[:64],
        "vehicle": PLANE,
    }
    return Flight(**(given | more))  # type: ignore[arg-type]


def several(key: str, peaks: list[float], minutes: float = 5.0, **more: object) -> list[Flight]:
    return [flight(f"{i}.tlog", {key: peak}, minutes, **more) for i, peak in enumerate(peaks)]


def outcome(learnt: Learnt, key: str) -> tuple[Outcome, float]:
    (change,) = [c for c in learnt.changes if c.key == key]
    return change.outcome, change.value


def test_a_threshold_is_raised_to_the_largest_healthy_maximum_and_a_margin() -> None:
    flights = several("imu.difference_sigma", [3.0, 5.5, 4.0])
    learnt = learn(flights, DEFAULTS)
    assert outcome(learnt, "imu.difference_sigma") == (Outcome.RAISED, 7.15)
    assert learnt.settings.imu.difference_sigma == 7.15
    (change,) = [c for c in learnt.changes if c.key == "imu.difference_sigma"]
    assert (change.peak, change.log, change.default) == (5.5, "1.tlog", 6.0)
    assert change.fault_growth == pytest.approx(7.15 / 6.0)


def test_the_margin_of_a_log_likelihood_is_that_of_the_fault_size_squared() -> None:
    learnt = learn(several("air.margin_all", [4.0, 12.0, 4.0]), DEFAULTS)
    assert outcome(learnt, "air.margin_all") == (Outcome.RAISED, 20.3)
    (change,) = [c for c in learnt.changes if c.key == "air.margin_all"]
    assert change.fault_growth == pytest.approx((20.3 / 15.0) ** 0.5)


def test_rounding_never_goes_below_what_was_meant() -> None:
    for peak in (4.6231, 5.0, 5.99, 0.123456e2):
        raised = learn(several("imu.noise_ratio", [peak * 3] * 3), DEFAULTS)
        value = outcome(raised, "imu.noise_ratio")[1]
        assert value >= min(1.3 * 3 * peak, 1.3 * 16.0) or value == 16.0


@pytest.mark.parametrize(
    ("flights", "minutes", "expected"),
    [
        (5, 12.0, (Outcome.LOWERED, 5.2)),
        (4, 30.0, (Outcome.KEPT_DATA, 6.0)),
        (6, 9.9, (Outcome.KEPT_DATA, 6.0)),
    ],
)
def test_a_threshold_is_lowered_on_five_flights_and_an_hour_only(
    flights: int, minutes: float, expected: tuple[Outcome, float]
) -> None:
    learnt = learn(several("imu.difference_sigma", [4.0] * flights, minutes), DEFAULTS)
    assert outcome(learnt, "imu.difference_sigma") == expected


def test_no_threshold_falls_below_its_floor() -> None:
    for rule in RULES:
        pair = {"imus": rule.least, "pitots": rule.least}
        flights = several(rule.key, [0.0] * 8, 20.0, **pair)
        default = default_of(DEFAULTS, rule.key)
        value = outcome(learn(flights, DEFAULTS), rule.key)[1]
        lowered = rule.floor is not None and rule.kind is Kind.STATISTIC
        assert value == (rule.floor if lowered else default), rule.key


def test_a_size_is_never_learnt() -> None:
    learnt = learn(several("imu.acc_size_m_s2", [0.6] * 6, 20.0), DEFAULTS)
    assert outcome(learnt, "imu.acc_size_m_s2") == (Outcome.KEPT_SIZE, 0.35)
    assert learnt.overrides == {}


@pytest.mark.parametrize(
    ("key", "aircraft"),
    [
        ("imu.difference_sigma", {"imus": 1}),
        ("imu.single_sigma", {"imus": 2}),
        ("air.margin_one", {"pitots": 1}),
    ],
)
def test_a_test_that_this_aircraft_does_not_make_teaches_nothing(
    key: str, aircraft: dict[str, int]
) -> None:
    learnt = learn(several(key, [50.0] * 3, **aircraft), DEFAULTS)
    assert outcome(learnt, key)[0] is Outcome.KEPT_UNSEEN


def test_a_silent_flight_bounds_what_its_test_needs() -> None:
    learnt = learn(several("imu.single_sigma", [9.0] * 3, imus=1), DEFAULTS)
    assert outcome(learnt, "imu.single_sigma") == (Outcome.RAISED, 7.8)


def test_what_was_measured_past_the_defaults_counts_in_full() -> None:
    wide = widened(DEFAULTS)
    flights = several("imu.difference_sigma", [9.0] * 3, settings=wide)
    learnt = learn(flights, DEFAULTS, measured=wide)
    assert outcome(learnt, "imu.difference_sigma") == (Outcome.RAISED, 11.7)
    assert learnt.settings.air.margin_all == DEFAULTS.air.margin_all


def test_a_threshold_that_would_blind_the_monitor_is_refused_with_the_log() -> None:
    wide = widened(DEFAULTS)
    peaks = [3.0, 14.5, 3.0]
    flights = several("imu.difference_sigma", peaks, settings=wide)
    with pytest.raises(Unfit, match=r"imu.difference_sigma would have to be 18.9 .* 1\.tlog"):
        learn(flights, DEFAULTS, measured=wide)


def test_flights_measured_with_other_settings_are_not_compared() -> None:
    with pytest.raises(ValueError, match="other settings"):
        learn(several("imu.difference_sigma", [5.0] * 3, settings=widened(DEFAULTS)), DEFAULTS)


@pytest.mark.parametrize(
    ("flights", "says"),
    [
        (several("imu.noise_ratio", [1.0] * 2, 30.0), "these 2 flights judged 60.0 min"),
        (several("imu.noise_ratio", [1.0] * 4, 2.4), "these 4 flights judged 9.6 min of imu0"),
        (several("imu.noise_ratio", [1.0], 99.0), "this flight judged 99.0 min"),
        ([flight(imus=0, pitots=0)] * 3, "judged no sensor"),
    ],
)
def test_too_little_is_refused_with_what_is_needed_and_what_there_is(
    flights: list[Flight], says: str
) -> None:
    with pytest.raises(TooLittle) as error:
        learn(flights, DEFAULTS)
    assert "need 3 healthy flights and 10 judged minutes of each sensor" in str(error.value)
    assert says in str(error.value)
    assert "\n" not in str(error.value)


def test_a_kind_of_sensor_that_was_hardly_judged_keeps_its_defaults() -> None:
    flights = [
        replace(f, judged_s={**f.judged_s, "airspeed0": 30.0, "airspeed1": 30.0})
        for f in (flight(n, {"air.margin_one": 7.9, "imu.difference_sigma": 5.5}) for n in "abcdef")
    ]
    learnt = learn(flights, DEFAULTS)
    assert set(learnt.overrides) == {"imu.difference_sigma"}
    assert learnt.hours == pytest.approx(0.5)


def test_leaving_a_flight_out_takes_its_peak_out() -> None:
    flights = several("imu.difference_sigma", [4.0, 5.9, 4.0, 4.0])
    assert learn(flights, DEFAULTS).overrides == {"imu.difference_sigma": 7.67}
    assert learn([f for f in flights if f is not flights[1]], DEFAULTS).overrides == {}


def test_different_vehicles_are_refused() -> None:
    with pytest.raises(Unfit, match=r"a\.tlog \(system 1, .* b\.tlog \(system 1, .*QUADROTOR"):
        check_alike([flight("a.tlog"), flight("b.tlog", vehicle=Vehicle(1, 3, 2))])
    with pytest.raises(Unfit, match="system 7"):
        check_alike([flight("a.tlog"), flight("b.tlog", vehicle=Vehicle(7, 3, 1))])


def test_the_same_flight_twice_is_refused_by_bytes_or_by_fixes() -> None:
    a, b = flight("a.tlog"), flight("b.tlog")
    check_alike([a, b])
    with pytest.raises(Unfit, match=r"a\.tlog and b\.tlog are the same flight"):
        check_alike([a, replace(b, sha256=a.sha256)])
    fixes = np.arange(1000, dtype=np.uint64)
    seen = replace(a, fixes=fixes)
    with pytest.raises(Unfit, match="same flight"):
        check_alike([seen, replace(b, fixes=fixes[300:900])])
    check_alike([seen, replace(b, fixes=fixes + np.uint64(700))])


def test_a_flight_with_a_fault_names_sensor_time_and_log() -> None:
    sick = flight("b.tlog", alarms=(Alarm("airspeed0", 141.26, "reads low"),))
    with pytest.raises(Unfit, match=r"b\.tlog is not .*airspeed0 faulty at 141\.3 s: reads low"):
        check_healthy([flight("a.tlog"), sick])
    check_healthy([flight("a.tlog")])


def test_a_disagreement_that_nobody_settles_is_no_healthy_flight_either() -> None:
    apart = Alarm("imu0.acc_x", 20.0, "imu0 and imu1 disagree", State.SUSPECT)
    with pytest.raises(Unfit, match=r"imu0\.acc_x suspect at 20\.0 s: imu0 and imu1 disagree"):
        check_healthy([flight(alarms=(apart,))])


def test_a_noise_level_is_raised_and_never_lowered() -> None:
    levels = {"gps_noise_m_s": 0.25, "baro_noise_m": 0.1, "pitot_apart": 0.3}
    changes = raised_levels(
        [flight(levels=levels), flight(levels={"gps_noise_m_s": 0.1})], DEFAULTS
    )
    assert {c.key: c.value for c in changes} == {
        "imu.gps_std_m_s": 0.25,
        "triplex.gps_std_m_s": 0.25,
        "air.scale_prior": 0.213,
        "triplex.scale_limit": 0.15,
    }


def test_levels_are_measured_from_samples() -> None:
    rng = np.random.default_rng(5)
    t = np.arange(0, 200_000_000, 200_000)
    course = np.sin(t * 1e-6 / 8.0)
    gps, nav = empty_rows("gps0", len(t)), empty_rows("nav", len(t))
    gps["t_us"] = nav["t_us"] = t
    nav["vel_ned_m_s"][:, 0] = 20.0 * course
    gps["vel_ned_m_s"] = nav["vel_ned_m_s"] + 0.3 * rng.standard_normal((len(t), 3))
    baro = empty_rows("baro0", len(t))
    baro["t_us"], baro["static_press_pa"] = t, 95000.0 + 10.0 * rng.standard_normal(len(t))
    one, other = empty_rows("airspeed0", len(t)), empty_rows("airspeed1", len(t))
    one["t_us"], other["t_us"] = t, t + 20_000
    one["cas_m_s"], other["cas_m_s"] = 20.0 * np.exp(0.08), 20.0
    rows = {"gps0": gps, "nav": nav, "baro0": baro, "airspeed0": one, "airspeed1": other}
    meter = LevelMeter()
    for part in range(4):
        meter.feed({s: r[part * 250 : (part + 1) * 250] for s, r in rows.items()})
    levels = meter.levels([(0, int(t[-1]))])
    assert levels["gps_noise_m_s"] == pytest.approx(0.3, rel=0.15)
    assert levels["baro_noise_m"] == pytest.approx(10.0 * 8435.0 / 95000.0, rel=0.15)
    assert levels["pitot_apart"] == pytest.approx(0.08, abs=1e-9)
    assert meter.levels([]) == {}


class Fleet:
    """Stands for the pipeline: flights whose alarms and peaks depend on a threshold."""

    def __init__(
        self,
        needs: list[float],
        incurable: bool = False,
        gps: float = 0.1,
        horizon: float = 0.0,
    ) -> None:
        self.needs, self.incurable, self.gps, self.horizon = needs, incurable, gps, horizon
        self.runs: list[Settings] = []
        self.passes: list[list[int]] = []

    def __call__(self, trials: Sequence[Trial], doing: str) -> list[Flight]:
        self.runs.append(trials[0][1])
        self.passes.append([k for k, _ in trials])
        return [self.fly(k, settings) for k, settings in trials]

    def fly(self, k: int, settings: Settings) -> Flight:
        limit, need = settings.imu.difference_sigma, self.needs[k]
        alarm = (Alarm("imu0.acc_x", 33.0, "disagrees"),)
        return flight(
            f"{k}.tlog",
            {
                "imu.difference_sigma": min(need, 1.01 * limit),
                "air.horizon.margin_all": self.horizon,
            },
            settings=settings,
            alarms=alarm if need > limit or self.incurable else (),
            levels={"gps_noise_m_s": self.gps},
        )

    def calibrated(self, settings: Settings = DEFAULTS, name: str = "", **how: bool) -> Calibration:
        return package.calibrate(self, len(self.needs), settings, name, **how)


def test_a_calibration_tries_out_what_it_learnt() -> None:
    fleet = Fleet([3.0, 5.0, 4.0])
    learnt = fleet.calibrated(name="ranger").learnt
    assert learnt.overrides == {"imu.difference_sigma": 6.5}
    assert fleet.runs == [DEFAULTS, learnt.settings]
    assert learnt.settings.learnt.airframe == "ranger"


def test_an_unhealthy_flight_is_refused_unless_the_operator_answers_for_it() -> None:
    with pytest.raises(Unfit, match=r"1\.tlog is not a healthy flight: imu0\.acc_x .*--assert"):
        Fleet([3.0, 9.0, 4.0]).calibrated()
    learnt = Fleet([3.0, 9.0, 4.0]).calibrated(assert_healthy=True).learnt
    assert learnt.overrides == {"imu.difference_sigma": 11.7}


def test_an_assertion_that_no_threshold_can_keep_is_refused() -> None:
    for fleet in (Fleet([3.0, 9.0, 4.0], incurable=True), Fleet([3.0, 40.0, 4.0])):
        with pytest.raises(Unfit, match="out of reach: leave that flight out"):
            fleet.calibrated(assert_healthy=True)


def test_one_flight_in_ten_that_is_not_healthy_is_left_out_and_named(tmp_path: Path) -> None:
    fleet = Fleet([3.0, 5.0, 4.0, 9.0])
    calibration = fleet.calibrated()
    assert calibration.learnt.overrides == {"imu.difference_sigma": 6.5}
    assert calibration.numbers == (0, 1, 2)
    (out,) = calibration.left_out
    assert (out.name, out.why) == ("3.tlog", "imu0.acc_x faulty at 33.0 s: disagrees")
    assert fleet.passes == [[0, 1, 2, 3], [0, 1, 2]]
    assert [log.name for log in calibration.learnt.settings.learnt.logs] == [
        "0.tlog",
        "1.tlog",
        "2.tlog",
    ]
    text = written(tmp_path, calibration).read_text()
    assert "# Left out, not healthy: 3.tlog: imu0.acc_x faulty at 33.0 s: disagrees\n" in text


def test_two_of_a_few_flights_are_not_the_exception() -> None:
    with pytest.raises(Unfit, match=r"3\.tlog is not .*: disagrees; nor is 4\.tlog \(--assert"):
        Fleet([3.0, 5.0, 4.0, 9.0, 9.0]).calibrated()
    many = [4.0] * 18
    assert len(Fleet([*many, 9.0, 9.0]).calibrated().left_out) == 2
    with pytest.raises(Unfit, match=r"nor are 19\.tlog, 20\.tlog"):
        Fleet([*many, 9.0, 9.0, 9.0]).calibrated()


def test_a_flight_that_was_said_to_be_healthy_and_cannot_be_is_left_out() -> None:
    fleet = Fleet([3.0, 9.0, 7.0, 40.0])
    calibration = fleet.calibrated(assert_healthy=True)
    assert calibration.learnt.overrides == {"imu.difference_sigma": 11.7}
    (out,) = calibration.left_out
    assert out.name == "3.tlog"
    assert out.why.endswith("disagrees, even with every threshold out of reach")
    assert calibration.flagged == 2
    assert fleet.passes == [[0, 1, 2, 3], [0, 1, 2, 3], [0, 1, 2], [0, 1, 2]]


def test_each_flight_is_judged_by_what_the_others_teach(tmp_path: Path) -> None:
    fleet = Fleet([5.0, 7.0, 12.0, 6.5])
    calibration = fleet.calibrated(assert_healthy=True)
    (change,) = [c for c in calibration.learnt.changes if c.key == "imu.difference_sigma"]
    assert (change.value, change.without, change.log, change.beyond) == (15.6, 9.1, "2.tlog", 3)
    checked = flagged_by_the_others(fleet, calibration)
    assert checked.crossed == (("2.tlog", Alarm("imu0.acc_x", 33.0, "disagrees")),)
    assert (fleet.passes[-1], fleet.runs[-1].imu.difference_sigma) == ([2], 9.1)
    text = " ".join(written(tmp_path, checked).read_text().replace("\n# ", " ").split())
    assert "3 of 4 flights are silent; not 2.tlog: imu0.acc_x faulty at 33.0 s." in text
    assert "15.6 without" not in text
    assert "9.1 without that flight" in text


def test_flights_that_resemble_each_other_hold_without_one() -> None:
    fleet = Fleet([7.0, 7.1, 7.2, 6.9])
    checked = flagged_by_the_others(fleet, fleet.calibrated(assert_healthy=True))
    assert checked.crossed == ()
    quiet = Fleet([2.0, 2.1, 2.2])
    checked = flagged_by_the_others(quiet, quiet.calibrated())
    assert (checked.crossed, checked.learnt.overrides) == ((), {})
    assert len(quiet.passes) == 2


def test_peaks_are_measured_with_the_noise_that_the_aircraft_shows() -> None:
    fleet = Fleet([3.0, 5.0, 4.0], gps=0.3)
    learnt = fleet.calibrated().learnt
    assert [run.imu.gps_std_m_s for run in fleet.runs] == [0.12, 0.3, 0.3]
    assert learnt.settings.imu.gps_std_m_s == 0.3
    assert "imu.gps_std_m_s" in learnt.settings.learnt.keys


def written(
    tmp_path: Path, calibration: Calibration, hand: dict[str, object] | None = None
) -> Path:
    file = tmp_path / "sentry.toml"
    file.write_text(document(calibration, hand or {}), encoding="utf-8")
    return file


def test_the_file_gives_back_exactly_what_was_learnt(tmp_path: Path) -> None:
    fleet = Fleet([3.0, 5.123, 4.0], gps=0.3)
    calibration = fleet.calibrated(configuration.load("light-aircraft"), "ranger")
    file = written(tmp_path, calibration)
    assert configuration.load(None, file) == calibration.learnt.settings
    origin = configuration.origins(None, file)
    assert origin["imu.difference_sigma"] == f"{file}, learnt from 3 flights, 0.25 h"
    assert origin["imu.noise_ratio"] == "default"
    assert origin["phase.flying_speed_m_s"] == "profile light-aircraft"


def test_every_key_of_the_file_says_what_it_rests_on(tmp_path: Path) -> None:
    calibration = Fleet([3.0, 5.0, 4.0]).calibrated()
    text = " ".join(written(tmp_path, calibration).read_text().replace("\n# ", " ").split())
    assert (
        "Raised: healthy maximum 5 (1.tlog) times 1.3, 3 flights, 0.25 h judged; 6 without that "
        "flight. Default 6. "
        "Floor 3.5: where suspicion begins; ordinary noise would be accused below it. "
        "difference_sigma = 6.5"
    ) in text
    assert "Floor the default: a physical size, no statistic." in text


def test_keys_set_by_hand_are_carried_along_and_learnt_ones_learnt_anew(tmp_path: Path) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text(
        'profile = "light-aircraft"\n[imu]\nnoise_ratio = 20.0\nclear_s = 9.0\n'
        "[air.horizon]\nmin_shift = 0.08\n[links.components]\nimu = [1, 2]\n"
    )
    settings, hand = configuration.by_hand(None, mine)
    fleet = Fleet([3.0, 5.0, 4.0], horizon=11.0)
    calibration = fleet.calibrated(settings)
    learnt = calibration.learnt
    assert set(learnt.overrides) == {"imu.difference_sigma", "air.horizon.margin_all"}
    file = written(tmp_path, calibration, hand)
    assert configuration.load(None, file) == learnt.settings
    assert configuration.load(None, file).imu.clear_s == 9.0
    again, hand_again = configuration.by_hand(None, file)
    assert hand_again == hand
    assert again == settings


def test_what_this_file_was_learnt_from_is_recognised(tmp_path: Path) -> None:
    log, other = tmp_path / "flown.tlog", tmp_path / "other.tlog"
    log.write_bytes(b"flight")
    other.write_bytes(b"another")
    learnt = LearntSettings(
        vehicle="system 1, A, B",
        hours=1.0,
        logs=(LearntLog(name="x", sha256=package.flights.digest(log), seconds=1.0),),
    )
    assert provenance(LearntSettings(), log, "") is None
    own = provenance(learnt, log, "system 1, A, B")
    assert own is not None
    assert (own["from_this_flight"], own["note"]) == (True, FROM_THIS_FLIGHT)
    unseen = provenance(learnt, other, "system 1, A, B")
    assert unseen is not None
    assert (unseen["from_this_flight"], unseen["note"]) == (False, None)
    foreign = provenance(learnt, other, "system 2, A, B")
    assert foreign is not None
    assert "another vehicle (system 1, A, B)" in foreign["note"]
