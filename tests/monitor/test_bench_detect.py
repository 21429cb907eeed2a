"""The detectability table: the harness finds what a known sensor and a known judge contain."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from links.samples import Batch
from links.vocabulary import State
from monitor import settings as monitor_settings
from monitor.cli import invoke
from monitor.commands.bench_detect import campaign, command, configurations, flights
from monitor.commands.bench_detect.campaign import Group, Kept, Plan, parts_of, run_all, run_part
from monitor.commands.bench_detect.configurations import LADDERS, Shape, Target, fitting
from monitor.commands.bench_detect.curves import picture
from monitor.commands.bench_detect.leave_one_out import leave_one_out
from monitor.commands.bench_detect.markdown import page
from monitor.commands.bench_detect.search import Outcome, search
from monitor.commands.bench_detect.table import alarm_rows, curve, rows
from monitor.commands.bench_detect.trials import fault_of, judge, moments, outcome_of, watch_healthy
from monitor.learn import TooLittle
from monitor.pipeline import Pipeline
from monitor.verdict import Verdict
from sim_feeds.attitude_follow import AttitudeFollows
from sim_feeds.injection import Injection, RowInjector

US = 1_000_000
LADDER = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0)
UNUSABLE = 2


# ----------------------------------------------------------------------------- blame


def faulty(t_s: float, sensor: str, detected_s: float | None = None) -> Verdict:
    detected_us = None if detected_s is None else round(detected_s * US)
    return Verdict(round(t_s * US), sensor, State.FAULTY, detected_t_us=detected_us)


def test_the_verdict_on_the_broken_axis_is_its_delay():
    verdicts = [
        Verdict(101 * US, "imu0.acc_x", State.SUSPECT),
        faulty(104.5, "imu0.acc_x", detected_s=101.5),
    ]
    outcome = outcome_of(verdicts, 100 * US, "imu0.acc_x", 60.0, pair_counts=False)
    assert outcome == Outcome(named_s=4.5, announced_s=1.5)


def test_another_axis_and_another_instrument_are_blame_errors():
    verdicts = [
        faulty(102.0, "imu0.gyro_y"),
        faulty(103.0, "imu0.acc_x"),
        faulty(104.0, "airspeed0"),
        faulty(105.0, "imu1.acc_x"),
        faulty(114.0, "imu0.acc_z"),  # more than ten seconds after it was named
    ]
    outcome = outcome_of(verdicts, 100 * US, "imu0.acc_x", 60.0, pair_counts=False)
    assert outcome.named_s == 3.0
    assert outcome.wrong_axis == ("imu0.gyro_y",)
    assert outcome.wrong_sensor == ("airspeed0", "imu1.acc_x")
    assert outcome.misled


def test_the_pair_is_an_answer_only_where_it_counts():
    verdicts = [faulty(102.0, "imu0.gyro_y")]
    counted = outcome_of(verdicts, 100 * US, "imu0.acc_x", 60.0, pair_counts=True)
    assert (counted.named_s, counted.as_pair, counted.misled) == (2.0, True, False)
    not_counted = outcome_of(verdicts, 100 * US, "imu0.acc_x", 60.0, pair_counts=False)
    assert not_counted == Outcome(wrong_axis=("imu0.gyro_y",), misled=True)


def test_verdicts_before_the_fault_and_after_the_window_do_not_count():
    verdicts = [faulty(99.0, "airspeed0"), faulty(161.0, "imu0.acc_x")]
    assert outcome_of(verdicts, 100 * US, "imu0.acc_x", 60.0, pair_counts=True) == Outcome()


# ----------------------------------------------------------------------------- faults


@pytest.mark.parametrize(
    ("sensor", "shape", "size", "before", "after_30_s"),
    [
        ("imu0.acc_x", Shape.STEP, -0.5, 2.0, 1.5),
        ("imu0.gyro_x", Shape.STEP, 3.0, 0.1, 0.1 + math.radians(3.0)),
        ("imu0.gyro_x", Shape.RAMP, 3.0, 0.1, 0.1 + math.radians(1.5)),
        ("airspeed0", Shape.STEP, -20.0, 20.0, 16.0),
        ("airspeed0", Shape.RAMP, 30.0, 20.0, 23.0),
        ("airspeed0", Shape.RAMP, -30.0, 20.0, 17.0),
        ("aoa0", Shape.STEP, 5.0, 0.0, math.radians(5.0)),
    ],
)
def test_sizes_are_in_the_units_of_the_table(sensor, shape, size, before, after_30_s):
    fault = fault_of(Target(sensor), shape, size, onset_s=100.0)
    read = fault.apply(
        np.array([99.0, 130.0]), np.array([before, before]), np.random.default_rng(0)
    )
    np.testing.assert_allclose(read, [before, after_30_s])


def test_every_quantity_has_ascending_sizes_close_together():
    for ladder in LADDERS.values():
        for sizes, apart in ((ladder.steps, 1.7), (ladder.ramps, 2.6)):
            ratios = np.diff(np.log(sizes))
            assert (ratios > 0).all()
            assert (ratios < math.log(apart)).all()


# ----------------------------------------------------------------------------- leave one out


def test_no_flight_is_judged_by_what_was_learnt_from_it():
    base = monitor_settings.load()
    logs = [Path(f"flight{k}.tlog") for k in range(4)]
    seen: list[tuple[Path, ...]] = []

    def learner(others, settings):
        seen.append(tuple(others))
        air = settings.air.model_copy(update={"wind_max_m_s": 20.0 + len(seen)})
        return settings.model_copy(update={"air": air})

    learnt, sentence = leave_one_out(logs, base, learner)
    assert seen == [tuple(log for log in logs if log != judged) for judged in logs]
    assert [s.air.wind_max_m_s for s in learnt] == [21.0, 22.0, 23.0, 24.0]
    assert "learnt from the 3 others" in sentence


def test_too_little_to_learn_from_leaves_the_bundled_profile_and_says_so():
    base = monitor_settings.load()

    def learner(others, settings):
        raise TooLittle("3 flights are needed; there is 1")

    learnt, sentence = leave_one_out([Path("a.tlog"), Path("b.tlog")], base, learner)
    assert learnt == [base, base]
    assert "bundled profile small-uav" in sentence
    assert "3 flights are needed" in sentence


# ----------------------------------------------------------------------------- whole parts


@pytest.fixture(scope="module")
def flight() -> flights.Flight:
    return flights.synthetic(flights.plan("small-uav", 3, 0, 1.2), monitor_settings.load())


def small(configuration, *sensors):
    return replace(configuration, targets=tuple(Target(s) for s in sensors))


ONE_PITOT = configurations.ONE_PITOT
TWO_IMUS = small(configurations.TWO_IMUS_FOLLOWED, "imu0.acc_x")


def group_of(flight, folder, *chosen, name="small-uav"):
    file = folder / "flight"
    flights.store(flight, file)
    base = monitor_settings.load()
    return Group(name, False, "small-uav", "thresholds of the profile", (file,), (base,), chosen)


def test_the_hard_trials_come_first_on_the_other_rungs():
    asked = []

    def judged(size: float, trial: int) -> Outcome:
        asked.append((size, trial))
        hard = trial in (4, 17)
        return Outcome(named_s=math.inf if hard and size < 7.0 else 1.0)

    assert search(LADDER, (10.0,), 20, judged).smallest == {10.0: 7.0}
    on_five = [trial for size, trial in asked if size == 5.0]
    assert sorted(on_five[:2]) == [4, 17]
    assert len(on_five) == 2


def test_six_flights_spread_over_the_winds():
    speeds = sorted(flights.plan("small-uav", 1, k, 2.0).wind[0].speed_m_s for k in range(6))
    assert max(np.diff(speeds)) < 12.0 / 3
    assert speeds[-1] - speeds[0] > 12.0 / 2


def test_the_same_number_gives_the_same_flight_and_another_one_another_wind():
    def flown(*which):
        return flights.plan("small-uav", *which, 2.0)

    assert flown(3, 0) == flown(3, 0)
    others = [flown(3, 1), flown(4, 0)]
    assert all(other.wind != flown(3, 0).wind for other in others)
    assert all(other.start.heading_deg != flown(3, 0).start.heading_deg for other in others)


@pytest.mark.parametrize("name", list(flights.CLASSES))
def test_every_class_takes_off_flies_and_lands(name):
    planned = flights.plan(name, 1, 0, 4.0)
    assert not planned.fault
    assert planned.leg[-2].do == "land"
    assert 4.0 < planned.duration_s / 60.0 < 12.0


@pytest.mark.parametrize(
    ("configuration", "size", "follows"),
    [(TWO_IMUS, 1.5, AttitudeFollows()), (configurations.TWO_PITOTS, 40.0, None)],
    ids=lambda value: getattr(value, "name", None),
)
def test_a_trial_from_a_kept_pipeline_is_what_the_whole_flight_gives(
    flight, configuration, size, follows
):
    base, rng = monitor_settings.load(), np.random.default_rng(2)
    target = configuration.targets[0]
    healthy = watch_healthy(flight, configuration, base, 20.0)
    assert healthy.false == ()
    drawn = moments([flight], [healthy], [base], configuration, 2, 20.0, rng)
    assert len(drawn) == 2
    assert all(any(a <= m.onset_us < b for a, b in healthy.spans_us) for m in drawn)
    for moment in drawn:
        outcome = judge(moment, configuration, target, Shape.STEP, size, 20.0)
        onset_s = (moment.onset_us - moment.first_us) / US
        fault = fault_of(target, Shape.STEP, size * moment.sense, onset_s)
        injector = RowInjector(Injection([fault], follows), moment.seed, flight.first_us)
        pipeline = Pipeline(configuration.settings(base))
        verdicts = pipeline.feed(injector.apply(configuration.thinned(flight.batch))).verdicts
        whole = outcome_of(verdicts, moment.onset_us, target.sensor, 20.0, pair_counts=False)
        assert outcome == whole
        assert outcome.named_s < 10.0


def test_moments_are_spread_over_all_the_time_there_is(flight):
    base = monitor_settings.load()
    healthy = watch_healthy(flight, TWO_IMUS, base, 20.0)
    drawn = moments([flight], [healthy], [base], TWO_IMUS, 4, 20.0, np.random.default_rng(0))
    (begin, end), *rest = healthy.spans_us
    if not rest:
        quarters = sorted(int(4 * (m.onset_us - begin) / (end - begin)) for m in drawn)
        assert quarters == [0, 1, 2, 3]
    no_time = replace(healthy, spans_us=())
    assert moments([flight], [no_time], [base], TWO_IMUS, 4, 20.0, np.random.default_rng(0)) == []


def test_instruments_are_taken_out(flight):
    assert flights.instruments([flight]) == (2, 2, 0)
    rows_left = ONE_PITOT.thinned(flight.batch).rows
    assert "airspeed0" in rows_left
    assert "airspeed1" not in rows_left
    blank = {s: r.copy() for s, r in flight.batch.rows.items()}
    for field in ("acc_m_s2", "gyro_rad_s"):
        blank["imu1"][field] = 0.0
    silent = flights.Flight("silent", Batch(blank), flight.first_us)
    assert flights.instruments([flight, silent]) == (2, 1, 0)
    names = [c.name for c in fitting(2, 1, 0, own_attitude=False)]
    assert names == [
        "one pitot",
        "two pitots",
        "one IMU, the attitude follows it",
        "one IMU, attitude of its own",
    ]


@pytest.fixture(scope="module")
def results(flight, tmp_path_factory):
    """Two small parts, their plan and their group."""
    folder = tmp_path_factory.mktemp("parts")
    group = group_of(flight, folder, small(ONE_PITOT, "airspeed0"), TWO_IMUS)
    plan = Plan(trials=2, seed=1, shapes=(Shape.STEP,))
    parts = parts_of([group], plan)
    file = folder / "kept.jsonl"
    told: list[float] = []
    found = run_all(parts, 1, Kept(file), told.append)
    return group, parts, found, file, told


def test_parts_are_kept_and_taken_up(results, monkeypatch):
    _, parts, found, file, told = results
    assert told[-1] == 1.0
    monkeypatch.setattr(campaign, "run_part", lambda *a: pytest.fail("was run again"))
    with file.open("a") as out:
        out.write('\n{"fingerprint": "torn')  # as a run leaves it that was ended
    Kept(file).add(parts[0], found[0])
    again = run_all(parts, 1, Kept(file), lambda fraction: None)
    assert json.dumps(again) == json.dumps(found)


def test_a_part_kept_with_another_seed_is_not_taken_up(results):
    _, parts, _, file, _ = results
    other = replace(parts[0], plan=replace(parts[0].plan, seed=2))
    assert Kept(file).get(parts[0]) is not None
    assert Kept(file).get(other) is None


def test_a_part_is_determined_by_its_seed(results):
    _, parts, found, _, _ = results
    assert json.dumps(run_part(parts[1])) == json.dumps(found[1])
    other = run_part(replace(parts[1], plan=replace(parts[1].plan, seed=2)))
    assert json.dumps(other) != json.dumps(found[1])


def test_two_processes_find_the_same(results):
    _, parts, found, _, _ = results
    assert json.dumps(run_all(parts, 2, Kept(None), lambda fraction: None)) == json.dumps(found)


def document_of(group, plan, found):
    return {
        **command._document([group], found, plan, False, 2, 61.0),
        "command": "mavsentry bench detect",
    }


def test_hours_are_those_judged_and_false_alarms_are_counted(results, flight):
    group, parts, found, _, _ = results
    judged_s = watch_healthy(flight, TWO_IMUS, group.settings[0], 60.0).judged_s
    assert 60.0 < judged_s < flight.duration_s
    document = document_of(group, parts[0].plan, found)
    table = {row.configuration: row for row in alarm_rows(document)}
    row = table[TWO_IMUS.name]
    assert row.judged_h == pytest.approx(judged_s / 3600.0, abs=1e-4)
    assert row.false == 0
    assert row.upper_per_h == pytest.approx(-math.log(0.05) / row.judged_h, rel=1e-3)


def test_the_page_says_what_was_found_and_nothing_of_this_machine(results):
    group, parts, found, _, _ = results
    document = document_of(group, parts[0].plan, found)
    text = page(document)
    (own,) = [row for row in rows(document["groups"][0]) if row.sensor == "acc_x"]
    line = next(line for line in text.splitlines() if line.startswith("| `acc_x` [m/s^2]"))
    assert line.split(" | ")[1:4] == list(own.step)
    assert "3 / hours" in text
    assert str(group.files[0].parent) not in text
    drawn = picture(document)
    assert drawn.startswith("<svg")
    assert "two IMUs" in drawn
    assert drawn.count("<circle") >= len(curve(found[1]["cells"][0], parts[0].plan.trials))


def test_announced_stands_beside_named_where_it_is_earlier(results):
    group, parts, found, _, _ = results
    changed = json.loads(json.dumps(found))
    cell = next(c for r in changed for c in r["cells"] if c["sensor"] == "imu0.acc_x")
    cell["rungs"] = [{"size": 1.0, "named_s": [6.0, 4.0], "announced_s": [1.0, 0.6]}]
    text = page(document_of(group, parts[0].plan, changed))
    assert "| announced / named |" in text
    assert "| 0.8 / 5.0 s |" in text


def test_a_curve_ends_where_too_few_were_found():
    cell = {
        "rungs": [
            {"size": 1.0, "named_s": [None, None]},
            {"size": 2.0, "named_s": [3.0] * 18 + [None, None]},
            {"size": 3.0, "named_s": [2.0] * 18 + [9.0, None]},
            {"size": 5.0, "named_s": [1.0] * 18 + [2.0, 4.0]},
        ]
    }
    assert curve(cell, 20) == [(3.0, 9.0), (5.0, 2.0)]


# ----------------------------------------------------------------------------- what is typed


def refused(capsys, *arguments) -> str:
    assert invoke(["bench", "detect", *map(str, arguments)]) == UNUSABLE
    said = capsys.readouterr()
    (sentence,) = said.err.splitlines()
    assert sentence.startswith("mavsentry: ")
    return sentence


def test_a_missing_log_is_refused(capsys):
    assert "/nowhere/flight.tlog" in refused(capsys, "/nowhere/flight.tlog")


def test_an_unknown_class_is_refused(capsys):
    sentence = refused(capsys, "--only", "zeppelin")
    assert "zeppelin" in sentence
    assert "light-aircraft" in sentence


def test_a_log_too_short_for_a_trial_is_refused(capsys, tmp_path):
    log = tmp_path / "hop.tlog"
    assert invoke(["feed", "demo", "--to", str(log)]) == 0
    capsys.readouterr()
    frames = log.read_bytes()
    log.write_bytes(frames[: len(frames) // 6])
    sentence = refused(capsys, log, "--only", tmp_path.name)
    assert "long enough" in sentence
    assert "60 s" in sentence


def test_options_before_detect_are_refused(capsys, tmp_path):
    assert invoke(["bench", "--json", str(tmp_path / "x.json"), "detect"]) == UNUSABLE
    assert "behind its name" in capsys.readouterr().err


def test_a_file_that_keep_did_not_write_is_refused_and_left_alone(capsys, tmp_path):
    file = tmp_path / "diary.txt"
    for text in (b"dear diary\n", b"\xff\xfe\x00", b'{"a": 1}\n{"b": 2}\n'):
        file.write_bytes(text)
        assert "diary.txt" in refused(capsys, "--quick", "--keep", file)
        assert file.read_bytes() == text


def test_the_quick_table_from_end_to_end(capsys, monkeypatch, tmp_path):
    tiny = command.Effort(trials=1, flights=1, minutes=1.5, classes=("small-uav",))
    monkeypatch.setattr(command, "QUICK", tiny)
    monkeypatch.setattr(
        configurations, "fitting", lambda *a, **k: [small(configurations.ONE_IMU, "imu0.acc_z")]
    )
    numbers = tmp_path / "numbers.json"
    arguments = ["--quick", "--jobs", "1", "--out", str(tmp_path), "--json", str(numbers)]
    assert invoke(["bench", "detect", *arguments]) == 0
    assert "acc_z [m/s^2]" in capsys.readouterr().out
    document = json.loads(numbers.read_text())
    assert document["schema"] == "mavsentry/detectability/1"
    (group,) = document["groups"]
    (part,) = group["configurations"]
    assert {cell["shape"] for cell in part["cells"]} == {"step", "ramp"}
    assert "acc_z" in (tmp_path / "detectability.md").read_text()
    assert (tmp_path / "detectability.svg").read_text().startswith("<svg")
