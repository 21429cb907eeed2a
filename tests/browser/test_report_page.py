"""Reports of four flights in Chromium: healthy, a pitot, an accelerometer, a dead sensor."""

import re

import numpy as np
import pytest
from matplotlib.image import imread

from monitor.analyze import analyze_log
from monitor.commands.feed import write_log
from monitor.recording import Estimates
from monitor.report import write_report
from monitor.report.flight import Flight
from monitor.report.tables import MemoryTables
from monitor.settings import load
from sim_feeds.scenario import load as load_scenario

from .flights import FAULTS, FLIGHT

pytestmark = pytest.mark.external

SAID = {
    "healthy": r"No fault was found in the \d+ sensors",
    "pitot": r"airspeed0 was faulty from 1:0\d to 1:\d\d: it read \d\.\d+ m/s too low",
    "imu": r"imu0\.acc_x was faulty from (0:59|1:00) to 1:\d\d: it read 2\.9\d? m/s² too high",
    "dead": r"airspeed1 was faulty from 1:00.*was dead",
}
BROKEN = {"pitot": "airspeed0", "imu": "imu0.acc_x", "dead": "airspeed1"}
"""Flight -> its verdict; flight -> the sensor that breaks, from a minute on."""


@pytest.fixture(scope="module")
def reports(tmp_path_factory):
    """Flight -> its report."""
    folder = tmp_path_factory.mktemp("reports")
    made = {}
    for name, faults in FAULTS.items():
        (folder / f"{name}.toml").write_text(FLIGHT + faults)
        log, settings, estimates = folder / f"{name}.tlog", load(), Estimates()
        write_log(load_scenario(folder / f"{name}.toml").fly(), log)
        analysis = analyze_log(log, settings, sink=estimates)
        tables = MemoryTables(estimates.joined())
        flight = Flight(analysis.summary, settings, analysis.verdicts, tables)
        (folder / name).mkdir()
        made[name] = write_report(folder / name, flight)
    return made


def lightness(visited, tmp_path, selector):
    """Median brightness of a picture of this place, 0 to 1."""
    place = visited.page.locator(selector).first
    place.scroll_into_view_if_needed()
    visited.wait_drawn()
    visited.page.wait_for_timeout(200)
    place.screenshot(path=tmp_path / "place.png")
    return float(np.median(imread(tmp_path / "place.png")[..., :3].mean(axis=-1)))


@pytest.mark.parametrize("name", SAID)
def test_a_report_says_shows_and_explains_what_was_found(reports, visit, name):
    report = visit(reports[name])
    assert re.search(SAID[name], report.page.locator("h1").inner_text())
    assert report.low_contrast() == []
    assert report.unnamed() == []
    report.screen(f"report-{name}")

    figures = report.figures()
    assert len(figures) >= 10
    for figure in figures:
        assert figure["width"] > 600, figure
        if "timeline" not in figure["name"]:
            assert any("(" in label for label in figure["axes"]), figure
    for chart in report.page.locator("figure.chart").all():
        place = f"#{chart.get_attribute('id')}"
        chart.scroll_into_view_if_needed()
        report.page.wait_for_timeout(50)
        assert report.inks(place) > 3, place

    evidence = {f["name"].split("-")[1] for f in figures if f["name"].startswith("fault-")}
    if name == "healthy":
        assert evidence == set()
        assert "ok" in report.hover("timeline", 75.0, "airspeed0")
        return
    assert evidence == {"1"}
    said = report.hover("timeline", 75.0, BROKEN[name])
    assert said.startswith(f"{BROKEN[name]}: faulty (")
    assert re.search(r"1:0\d to 1:\d\d", said), said
    value = report.hover("fault-1-measured", 75.0)
    assert re.search(r"time: (75\.\d s|1:15)", value), value
    assert re.search(r"measured[^:]*: \S+( to \S+)? m/s", value), value


def test_it_is_dark_where_the_system_is(reports, visit, tmp_path):
    report = visit(reports["imu"], dark=True)
    assert lightness(report, tmp_path, "header") < 0.25
    assert lightness(report, tmp_path, "figure.chart .plots") < 0.25
    assert report.low_contrast() == []
    report.screen("report-imu-dark")


def test_the_theme_has_a_switch(reports, visit, tmp_path):
    report = visit(reports["pitot"])
    assert lightness(report, tmp_path, "figure.chart .plots") > 0.8
    report.page.locator("[data-switch-theme]").click()
    assert lightness(report, tmp_path, "figure.chart .plots") < 0.25
    assert report.low_contrast() == []


@pytest.mark.parametrize("name", ["healthy", "pitot"])
def test_a_phone_shows_all_of_it_without_scrolling_sideways(reports, visit, name):
    report = visit(reports[name], phone=True)
    figures = report.figures()
    assert report.overflow_px() <= 0, report.too_wide()
    assert report.too_wide() == []
    assert max(f["width"] for f in figures) <= 400
    assert report.low_contrast() == []
    report.screen(f"report-{name}-phone")


def test_the_keyboard_reaches_links_buttons_and_tables_and_shows_where_it_is(reports, visit):
    report = visit(reports["pitot"])
    stops = report.tab_stops()
    assert stops[0]["href"] == "#content"
    assert [s for s in stops if not s["seen"]] == []
    reached = {stop["href"] for stop in stops}
    sections = {link.get_attribute("href") for link in report.page.locator("nav a").all()}
    assert len(sections) >= 8
    assert sections <= reached
    assert {"Dark", "Print"} <= {stop["name"] for stop in stops}
    report.page.locator("nav a").nth(1).press("Enter")
    assert report.page.url.endswith("#evidence")


def test_paper_gets_every_chart_in_light_colours(reports, visit, tmp_path):
    report = visit(reports["pitot"], dark=True)
    count = len(report.figures())
    printed = report.page.pdf(path=tmp_path / "report.pdf", format="A4", print_background=True)
    if report.screens is not None:
        (report.screens / "report-pitot.pdf").write_bytes(printed)
    assert printed.count(b"/Subtype /Image") >= count


def test_without_javascript_the_words_are_all_there(reports, visit):
    report = visit(reports["imu"], java_script_enabled=False)
    assert re.search(SAID["imu"], report.page.locator("h1").inner_text())
    assert "imu0.acc_x" in report.page.locator("main").inner_text()
