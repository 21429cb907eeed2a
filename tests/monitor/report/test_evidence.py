"""The evidence of flights with one thing broken: what is drawn, what is said, how much of it."""

from __future__ import annotations

import copy
import math
import re
from collections.abc import Iterator

import numpy as np
import pytest

pytest.importorskip("bokeh", reason="the report needs the extra report")

from bokeh.models import ColumnDataSource, GlyphRenderer, Range1d

from links.vocabulary import State
from monitor.pages import html
from monitor.report import evidence
from monitor.report.evidence_cases import anchors, cases_of, groups_of
from monitor.report.evidence_data import subject_of
from monitor.report.evidence_numbers import value_at
from monitor.report.evidence_scene import Scene
from monitor.report.flight import Flight
from monitor.report.page import frame
from monitor.report.section import Chart, Part, Section, Table, Text
from monitor.report.verdict_sentence import top
from tests.monitor.report import evidence_flights as flights

NUMBER = re.compile(r"\d")


def of(flight: Flight) -> Section:
    found = evidence.section(flight, Range1d(0.0, flight.duration_s))
    assert found is not None
    return found


def parts(section: Section) -> Iterator[Part]:
    for part in section.parts:
        yield part
        if isinstance(part, Section):
            yield from parts(part)


def charts(section: Section) -> dict[str, Chart]:
    return {part.key: part for part in parts(section) if isinstance(part, Chart)}


def titles(section: Section) -> list[str]:
    return [part.title for part in section.parts if isinstance(part, Section)]


def scenes(flight: Flight) -> Iterator[Scene]:
    streams = [stream["sensor"] for stream in flight.summary["streams"]]
    for group in groups_of(cases_of(flight.summary), flight.duration_s):
        subject = subject_of(group.sensor, streams, flight.settings)
        assert subject is not None
        yield Scene(flight, group, subject, group.cases[0].key)


def drawn(chart: Chart) -> Iterator[np.ndarray]:
    """Finite values of everything that each figure of a chart shows."""
    for model in chart.models:
        values = [np.empty(0)]
        for renderer in model.renderers:
            if isinstance(renderer, GlyphRenderer) and renderer.glyph.line_alpha != 0.0:
                source = renderer.data_source
                assert isinstance(source, ColumnDataSource)
                values.append(np.asarray(source.data["y"], float))
        joined = np.concatenate(values)
        yield joined[np.isfinite(joined)]


@pytest.fixture(scope="session")
def machines() -> dict[str, Flight]:
    pytest.importorskip("jsbsim", reason="the vehicle needs the extra sim")
    return {
        "dead channel": flights.with_channel(flights.dead),
        "high channel": flights.with_channel(flights.high, 1),
        "engine cut, two channels": flights.engine_cut(2),
        "engine cut, none": flights.engine_cut(0),
        "wing": flights.wing_damaged(),
    }


def check_charts(flight: Flight) -> None:
    """No chart is empty, each is said in words with numbers, and holds onset and verdict."""
    found = of(flight)
    made = charts(found)
    assert made
    for chart in made.values():
        assert all(len(values) > 5 for values in drawn(chart)), chart.key
        assert NUMBER.search(chart.alt)
        assert NUMBER.search(chart.caption)
        assert "nan" not in chart.alt + chart.caption
    for scene in scenes(flight):
        own = [chart for key, chart in made.items() if key.startswith(f"{scene.key}-")]
        ranges = {id(model.x_range) for chart in own for model in chart.models}
        assert len(ranges) == 1  # the charts of a finding move together
        axis = own[0].models[0].x_range
        for case in scene.group.cases:
            assert axis.start <= case.onset_s <= case.isolated_s <= axis.end
    for part in parts(found):
        if isinstance(part, Text):
            assert part.words.endswith(".")


def test_a_pitot_and_an_accelerometer(flight: Flight) -> None:
    check_charts(flight)
    found = of(flight)
    pitot, force = titles(found)
    assert re.match(r"airspeed0 faulty: .* from 1:1\d, found \d\.\d s later, ", pitot)
    assert re.search(r", cleared [12]:\d\d$", pitot)
    assert re.match(r"imu0.acc_x faulty: [23]\.\d m/s² high from 2:00, ", force)
    made = charts(found)
    for name in ("measured", "error", "others"):
        assert {f"fault-1-{name}", f"fault-2-{name}"} <= set(made)
    assert "fault-1-wind" in made
    assert "airspeed1" in made["fault-1-others"].caption
    assert "imu0 − imu1" in made["fault-2-others"].caption


def test_the_drawn_error_is_that_of_the_verdict(flight: Flight) -> None:
    """Within two deviations of the reconstruction, and a tenth of it for what lies between.

    A verdict's size is a mean over up to a second before it; the sensor and the air have moved on.
    """
    for scene in scenes(flight):
        size = float(scene.case.found["magnitude"])
        error = value_at(scene.error, scene.said_s)
        std = value_at(scene.error_std, scene.said_s)
        assert abs(error - size) < 2.0 * std + 0.1 * abs(size), scene.case


def test_before_the_onset_it_agreed(flight: Flight) -> None:
    """What one sees left of the onset: an error well below what it is afterwards."""
    for scene in scenes(flight):
        assert scene.error is not None
        before = scene.error.middle[scene.error.t_s < scene.case.onset_s - 0.5]
        assert before.size > 50
        assert np.nanmedian(np.abs(before)) < 0.25 * abs(scene.case.found["magnitude"])


@pytest.mark.parametrize(
    ("name", "title", "keys"),
    [
        ("dead channel", r"spool0 faulty: dead from 1:20, found", "measured error others power"),
        ("high channel", r"spool0 faulty: 5\d\d rpm high from 1:20", "measured error throttle"),
        ("engine cut, two channels", r"engine0 stopped: from 1:20", "throttle power speed spools"),
        ("engine cut, none", r"engine0 stopped: from 1:2\d", "throttle energy speed"),
        ("wing", r"wing_right.lift faulty: \d\.\d % less lift than the other wing from 1:0\d",
         "wings error flown"),
    ],
)  # fmt: skip
def test_engines_and_wings(machines: dict[str, Flight], name: str, title: str, keys: str) -> None:
    flight = machines[name]
    check_charts(flight)
    found = of(flight)
    assert re.match(title, titles(found)[0])
    made = {key.rpartition("-")[2] for key in charts(found)}
    assert set(keys.split()) <= made


def test_the_wings_drawn_difference_is_that_of_the_verdict(machines: dict[str, Flight]) -> None:
    (scene,) = scenes(machines["wing"])
    other = scene.column("wing", scene.subject.peers[0])
    at_s = scene.case.isolated_s
    apart = value_at(scene.error, at_s) - value_at(other, at_s)
    assert apart == pytest.approx(-scene.case.found["magnitude"], abs=0.01)


def test_without_tables_it_says_so_instead_of_drawing(flight: Flight) -> None:
    from monitor.report.tables import MemoryTables

    bare = Flight(flight.summary, flight.settings, flight.verdicts, MemoryTables({}))
    found = of(bare)
    assert not charts(found)
    said = [part.words for part in parts(found) if isinstance(part, Text)]
    assert "Nothing of airspeed0 was recorded at this time." in said
    assert titles(found) == titles(of(flight))
    frame(top(bare), [found])


def test_nothing_was_found(flight: Flight) -> None:
    summary = flight.summary | {"faults": [], "events": []}
    clean = Flight(summary, flight.settings, flight.verdicts, flight.tables)
    assert evidence.section(clean, Range1d(0.0, 1.0)) is None


def test_two_hundred_findings_stay_a_page(flight: Flight) -> None:
    """Twenty in full, the others in a table, each with an anchor; 10 MB at most beside BokehJS."""
    summary = copy.deepcopy(flight.summary)
    for k in range(200):
        again = copy.deepcopy(summary["faults"][k % 2])
        shift_s = 0.4 * k
        for key in ("onset_s", "detected_s", "isolated_s"):
            again[key] += shift_s
        again["cleared_s"] = again["isolated_s"] + 0.2
        again["sensor"] = f"imu{k % 2}.gyro_{'xyz'[k % 3]}" if k % 4 else "airspeed1"
        summary["faults"].append(again)
    many = Flight(summary, flight.settings, flight.verdicts, flight.tables)
    found = of(many)
    page = frame(top(many), [found])
    assert len(page) - len(html.bokeh_script()) < 10e6
    drawn_here = [part for part in found.parts if isinstance(part, Section)]
    assert len(drawn_here) <= 21
    ids = set(re.findall(r'id="([^"]+)"', page))
    for key, anchor in anchors(summary, many.duration_s).items():
        assert anchor in ids, key


def test_a_sensor_that_failed_three_times_has_a_row_for_each(flight: Flight) -> None:
    summary = copy.deepcopy(flight.summary)
    first = summary["faults"][0]
    first["cleared_s"] = first["isolated_s"] + 3.0
    for k in (1, 2):
        again = copy.deepcopy(first)
        for key in ("onset_s", "detected_s", "isolated_s", "cleared_s"):
            again[key] += 8.0 * k
        summary["faults"].append(again)
    found = of(Flight(summary, flight.settings, flight.verdicts, flight.tables))
    section = next(part for part in found.parts if isinstance(part, Section))
    assert section.title.startswith("airspeed0 faulty 3 times between 1:10 and ")
    table = next(part for part in section.parts if isinstance(part, Table))
    assert len(table.rows) == 3
    assert "faulty 3 times on this flight, for 9.0 s in all" in table.caption


def test_all_axes_of_a_dead_imu_are_drawn_together(flight: Flight) -> None:
    summary = copy.deepcopy(flight.summary)
    force = summary["faults"].pop()
    for kind in ("acc", "gyro"):
        for axis in "xyz":
            dead = {"sensor": f"imu0.{kind}_{axis}", "kind": "dropout", "magnitude": None}
            summary["faults"].append(force | dead)
    found = of(Flight(summary, flight.settings, flight.verdicts, flight.tables))
    assert titles(found)[1].startswith("imu0 (all axes) faulty: dead from 2:00")
    assert {"fault-2-acc", "fault-2-gyro"} <= set(charts(found))


def test_the_span_in_which_it_is_faulty_is_shaded_from_the_verdict_on(flight: Flight) -> None:
    from bokeh.models import BoxAnnotation

    chart = charts(of(flight))["fault-1-error"].models[0]
    (box,) = [item for item in chart.center if isinstance(item, BoxAnnotation)]
    case = cases_of(flight.summary)[0]
    assert box.left == case.isolated_s
    assert box.right == min(case.until(flight.duration_s), chart.x_range.end)
    spans = flight.spans["airspeed0"]
    (faulty,) = [span for span in spans if span.state is State.FAULTY]
    assert math.isclose(faulty.from_s, box.left, abs_tol=1e-3)


@pytest.mark.parametrize(("most", "scale"), [(5.0, "LinearScale"), (60.0, "LogScale")])
def test_a_ratio_of_any_size_is_drawn_over_its_threshold(
    flight: Flight, most: float, scale: str
) -> None:
    """It passes 1 half a second after the onset; the table is made up."""
    from monitor.report.tables import MemoryTables
    from monitor.verdict import AIR_TESTS

    (case, *_) = cases_of(flight.summary)
    t_s = np.arange(case.onset_s - 30.0, case.isolated_s + 60.0, 0.2)
    rows = np.zeros(len(t_s), AIR_TESTS)
    rows["t_us"] = flight.first_us + np.round(t_s * 1e6)
    rows["airspeed0_ratio"] = np.clip(
        0.3 + (t_s - case.onset_s) / 0.7 * (t_s > case.onset_s), 0, most
    )
    tested = Flight(
        flight.summary, flight.settings, flight.verdicts, MemoryTables({"air_tests": rows})
    )
    chart = charts(of(tested))["fault-1-test"]
    (figure,) = chart.models
    assert type(figure.y_scale).__name__ == scale
    assert "Before the onset it reached 0.3. It reached 1, its threshold, 0." in chart.caption
    assert f"went up to {most:.3g}." in chart.caption
    (values,) = drawn(chart)
    assert values.max() == pytest.approx(most)
