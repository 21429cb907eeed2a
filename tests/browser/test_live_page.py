"""The live page in Chromium, against a stand-in that says what each test wants it to hear."""

import time
from itertools import count

import pytest

from monitor.web.figures import catalogue
from tests.monitor.web.example import END_S, FAULTY_S, RATE_HZ, all_frames, hello

pytestmark = pytest.mark.external

CHARTS = ["airspeed", "aoa", "wind", "air-tests", "imu0-acc", "imu0-gyro", "imu0-tests", "engine"]
"""Those whose sensors the example flight has, in the order of the page."""

FRAMES = list(all_frames())


@pytest.fixture
def daemon():
    pytest.importorskip("tornado")
    from .live_stand_in import StandIn

    with StandIn() as stand_in:
        yield stand_in


def until(to_s):
    """Hello and one history message with all frames up to then."""
    before = [frame for frame in FRAMES if frame["number"] <= to_s * RATE_HZ]
    return hello(before), {"kind": "history", "last": True, "frames": before}


def then(from_s, to_s):
    return [f for f in FRAMES if from_s * RATE_HZ < f["number"] <= to_s * RATE_HZ]


def waits(page, condition, timeout_s=12.0):
    """Playwright's own waiting needs ``eval``, which the page's policy forbids."""
    end_s = time.monotonic() + timeout_s
    while not page.evaluate(condition):
        assert time.monotonic() < end_s, f"not within {timeout_s:g} s: {condition}"
        page.wait_for_timeout(50)


def text(page, place):
    return page.locator(place).inner_text()


def beats(daemon, page, frame, seconds):
    """The same frame again, as a link that is silent has it, so that the page stays connected."""
    for i in range(int(seconds * 5)):
        daemon.say(frame | {"number": frame["number"] + 1 + i})
        page.wait_for_timeout(200)


def test_a_flight_is_shown_and_only_its_sensors(daemon, visit, screens):
    daemon.say(*until(90.0), *then(90.0, 100.0))
    visited = visit(daemon.address)
    page = visited.page
    waits(page, "document.querySelectorAll('.chart').length === 8")
    keys = page.eval_on_selector_all(".chart", "all => all.map(c => c.dataset.key)")
    assert keys == CHARTS
    waits(page, "document.title.startsWith('✕ airspeed0 faulty')")
    waits(page, "document.querySelector('#alarm-lines li')")
    said = text(page, "#alarm")
    assert "airspeed0 FAULTY 5.0 m/s low, drift since 1:01 (39 s ago)" in " ".join(said.split())
    assert "airspeed0 reads 5.0 m/s less than ground speed and wind say" in said
    assert page.locator("[role=alert]").inner_text().startswith("airspeed0 faulty.")
    waits(page, "document.querySelector('#chart-airspeed b').textContent !== ''")
    assert "airspeed0" in text(page, "#chart-airspeed .key")
    assert "airspeed1" not in text(page, "#chart-airspeed .key")
    assert "Not fitted: imu2." in text(page, "main")
    assert visited.unnamed() == []
    visited.wait_drawn()
    visited.screen("live-fault")


def test_a_clock_that_goes_back_begins_the_window_anew(daemon, visit):
    daemon.say(*until(50.0), FRAMES[251] | {"t_s": 2.0}, FRAMES[252] | {"t_s": 2.2})
    page = visit(daemon.address).page
    waits(page, "app.store.t_s === 2.2")
    assert page.evaluate("app.store.written") == 2
    assert page.evaluate("app.timeline.spans.get('aoa0').map(one => one.t_s)") == [2.0]


def test_a_sensor_that_comes_later_gets_its_place(daemon, visit):
    first, history = until(20.0)
    late = [{k: v for k, v in frame.items() if k != "imu"} for frame in history["frames"]]
    daemon.say(first, history | {"frames": late})
    page = visit(daemon.address).page
    keys = "[...document.querySelectorAll('.chart')].map(chart => chart.dataset.key)"
    waits(page, f"{keys}.length === {len(CHARTS) - 2}")
    daemon.say(*then(20.0, 21.0))
    waits(page, f"{keys}.length === {len(CHARTS)}")
    assert page.evaluate(keys) == CHARTS


def test_a_recorder_that_stopped_is_told_among_what_is_wrong(daemon, visit):
    stopped = {"file": "a.tlog", "file_bytes": 1, "bytes": 1, "stopped": "No space left on device"}
    daemon.say(*until(20.0), FRAMES[101] | {"recorder": stopped})
    page = visit(daemon.address).page
    waits(page, "document.getElementById('alarm').textContent.includes('Not recording')")
    assert "No space left on device" in text(page, "#alarm")
    assert "STOPPED: No space left on device" in text(page, "#recorder-facts")


def test_what_is_drawn_is_what_was_said(daemon, visit):
    """The source of the airspeed chart holds the frames' values at their times."""
    daemon.say(*until(100.0))
    page = visit(daemon.address).page
    waits(page, "app.made.get('airspeed')?.drawn_ms > 0")
    page.wait_for_timeout(300)
    rows = page.evaluate(
        "Object.fromEntries(Object.entries(app.made.get('airspeed').doc.get_model_by_name('rows')"
        ".data).map(([name, values]) => [name, [...values]]))"
    )
    ends = {frame["t_s"]: frame for frame in FRAMES}
    now = ends[100.0]
    assert sorted(rows["airspeed0"][-2:]) == pytest.approx(now["measured"]["airspeed0"], abs=1e-4)
    assert rows["air.cas_m_s"][-1] == pytest.approx(now["air"]["cas_m_s"], abs=1e-4)
    band = rows["air.cas_m_s.high"][-1] - rows["air.cas_m_s.low"][-1]
    assert band == pytest.approx(4 * now["air"]["cas_std_m_s"], abs=1e-3)
    lowest = min(f["measured"]["airspeed0"][0] for f in FRAMES if f["t_s"] <= 100.0)
    assert min(rows["airspeed0"]) == pytest.approx(lowest, abs=1e-4), "a peak was lost"
    assert rows["x"] == sorted(rows["x"])
    assert rows["x"][0] == pytest.approx(-100.0, abs=1.0)


def test_a_gap_is_a_gap_in_lines_and_bands(daemon, visit):
    """Five seconds are missing: the line breaks, and the band has no height between."""
    first, history = until(100.0)
    history["frames"] = [f for f in history["frames"] if not 70.0 < f["t_s"] < 75.0]
    daemon.say(first, history)
    page = visit(daemon.address).page
    waits(page, "app.made.get('airspeed')?.drawn_ms > 0")
    page.wait_for_timeout(300)
    rows = page.evaluate(
        "Object.fromEntries(Object.entries(app.made.get('airspeed').doc.get_model_by_name('rows')"
        ".data).map(([name, values]) => [name, [...values].map(v => v === v ? v : null)]))"
    )
    holes = [i for i, v in enumerate(rows["air.cas_m_s"]) if v is None]
    assert len(holes) == 2
    assert [rows["x"][i] for i in holes] == pytest.approx([-30.0, -25.0], abs=0.6)
    for i in holes:
        assert rows["air.cas_m_s.low"][i] == rows["air.cas_m_s.high"][i]
    assert rows["air.cas_m_s.high"][-1] - rows["air.cas_m_s.low"][-1] > 3.0


def test_a_silent_vehicle_is_not_a_lost_connection(daemon, visit):
    daemon.say(*until(END_S))
    page = visit(daemon.address).page
    waits(page, "document.documentElement.dataset.link === 'silent'")
    waits(page, "document.getElementById('live').textContent.includes('silent')")
    assert "The vehicle is silent: nothing for 4 s" in text(page, "#connection")
    assert "mavsentry itself answers" in text(page, "#connection")
    assert page.title().startswith("vehicle silent")
    assert text(page, "#chart-airspeed li:first-child b").strip() == "–", (
        "an old number looks like a value"
    )
    beats(daemon, page, FRAMES[-1], 1.0)
    assert page.evaluate("app.connection.open")


def test_a_lost_connection_says_so_and_comes_back_with_a_new_flight(daemon, visit):
    visit.forgiven.append("WebSocket connection to")
    daemon.say(*until(100.0), *then(100.0, 101.0))
    page = visit(daemon.address).page
    waits(page, "document.querySelectorAll('.chart').length === 8")
    daemon.stop()
    waits(page, "document.documentElement.dataset.link === 'lost'")
    waits(page, "document.getElementById('connection').textContent.includes('No connection')")
    assert "The last frame came at" in text(page, "#connection")
    assert page.title().startswith("no connection")
    assert text(page, "#chart-airspeed li:first-child b").strip() == "–"
    assert "No connection" in page.locator("#spoken").inner_text()
    page.wait_for_timeout(1500)
    daemon.forget()
    daemon.start()
    first, history = until(20.0)
    for frame in history["frames"]:
        frame.pop("imu", None)
    daemon.say(first | {"run": "another"}, history, *then(20.0, 21.0))
    waits(page, "document.documentElement.dataset.link === 'live'")
    waits(page, "app.run === 'another'")
    assert page.evaluate("app.store.t_s") == pytest.approx(21.0)
    assert page.evaluate("app.faults.size") == 0
    waits(page, "!document.querySelector('#alarm-lines li')")


def test_the_same_run_keeps_what_was_seen(daemon, visit):
    visit.forgiven.append("WebSocket connection to")
    daemon.say(*until(60.0))
    page = visit(daemon.address).page
    waits(page, "app.store.t_s === 60")
    daemon.stop()
    daemon.forget()
    daemon.start()
    daemon.say(hello(then(-1.0, 80.0)), {"kind": "history", "last": True, "frames": then(50, 80)})
    waits(page, "app.store.t_s === 80")
    assert page.evaluate("app.store.rows(0, 80)") == [0, 401], "a row is missing or there twice"
    daemon.say(*then(80.0, 81.0))
    waits(page, "app.store.t_s === 81")
    assert page.evaluate("app.missed") == 0


def test_a_frame_that_never_comes_is_noticed(daemon, visit):
    """A connection that is open and says nothing is as good as lost."""
    visit.forgiven.append("WebSocket connection to")
    daemon.say(*until(60.0))
    page = visit(daemon.address).page
    waits(page, "app.store.t_s === 60")
    came = daemon.opened
    waits(page, "document.documentElement.dataset.link === 'lost'")
    page.wait_for_timeout(1500)
    assert daemon.opened > came


def test_a_daemon_that_gets_ready_is_not_lost(daemon, visit):
    page = visit(daemon.address).page
    waits(page, "document.getElementById('connection').textContent.includes('getting ready')")
    assert "No connection" not in text(page, "#connection")
    page.wait_for_timeout(5000)
    assert daemon.opened == 1, "it was given up for lost"


def test_a_hidden_tab_draws_nothing_and_still_tells(daemon, visit):
    daemon.say(*until(50.0), *then(50.0, 51.0))
    page = visit(daemon.address).page
    waits(page, "app.made.get('airspeed')?.drawn_ms > 0")
    page.evaluate(
        "Object.defineProperty(document, 'hidden', { value: true, configurable: true });"
        "document.dispatchEvent(new Event('visibilitychange'))"
    )
    spent = None
    while spent != (spent := page.evaluate("app.painter.spent_ms")):  # what was begun is finished
        page.wait_for_timeout(1000)
    before = page.evaluate("[app.painter.spent_ms, document.getElementById('clock').textContent]")
    daemon.say(*then(51.0, FAULTY_S + 5.0))
    waits(page, "document.title.startsWith('✕ airspeed0 faulty')")
    page.wait_for_timeout(500)
    after = page.evaluate("[app.painter.spent_ms, document.getElementById('clock').textContent]")
    assert after == before
    assert page.evaluate("app.store.t_s") == FAULTY_S + 5.0
    page.evaluate("delete document.hidden; document.dispatchEvent(new Event('visibilitychange'))")
    waits(page, "document.getElementById('clock').textContent === '1:15'")
    waits(page, f"app.painter.spent_ms > {before[0]}")


def test_keys_pause_and_change_the_window(daemon, visit):
    daemon.say(*until(60.0), *then(60.0, 61.0))
    page = visit(daemon.address).page
    waits(page, "app.made.get('airspeed')?.drawn_ms > 0")
    page.keyboard.press("p")
    assert page.locator("#pause").get_attribute("aria-pressed") == "true"
    paused = page.evaluate("app.now().to_s")
    daemon.say(*then(61.0, FAULTY_S))
    waits(page, "document.querySelector('#alarm-lines li')")
    assert page.evaluate("app.now().to_s") == paused, "a paused chart moved"
    page.keyboard.press("5")
    waits(page, "app.made.get('airspeed').plot.x_range.start === -300")
    page.keyboard.press("p")
    assert page.evaluate("app.now().to_s") == FAULTY_S
    page.keyboard.press("d")
    assert page.evaluate("Theme.dark()")
    assert page.evaluate("app.audio ?? null") is None, "sound is off until it is asked for"
    page.keyboard.press("s")
    assert page.evaluate("app.audio?.state") in ("running", "suspended")
    assert page.locator("#sound").is_checked()


def test_pointing_tells_the_value_of_then(daemon, visit):
    daemon.say(*until(100.0))
    visited = visit(daemon.address)
    page = visited.page
    waits(page, "app.made.get('airspeed')?.drawn_ms > 0")
    waits(page, "app.timeline.view")
    page.locator("#plot-airspeed").scroll_into_view_if_needed()
    box = page.locator("#plot-airspeed").bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 60)
    waits(page, "app.made.get('airspeed').at_s !== null")
    at_s = page.evaluate("app.made.get('airspeed').at_s")
    assert at_s == pytest.approx(-62.0, abs=6.0)
    then_read = FRAMES[int((100.0 + at_s) * RATE_HZ)]["measured"]["airspeed0"]
    shown = text(page, "#chart-airspeed .key li:nth-child(2) b")
    assert float(shown) == pytest.approx(sum(then_read) / 2, abs=0.11)
    assert text(page, "#chart-airspeed .when").startswith("−")
    page.mouse.move(box["x"], 5)
    waits(page, "app.made.get('airspeed').at_s === null")
    page.locator("#plot-timeline").scroll_into_view_if_needed()
    box = page.locator("#plot-timeline").bounding_box()
    row = page.evaluate("app.timeline.sensors.indexOf('airspeed0')")
    page.mouse.move(box["x"] + 0.9 * box["width"], box["y"] + 6 + 16 * (row + 0.5))
    waits(page, "document.getElementById('timeline-readout').textContent.includes('airspeed0')")
    assert "faulty: 5.0 m/s low, drift: airspeed0 reads" in text(page, "#timeline-readout")


@pytest.mark.parametrize(("dark", "phone"), [(True, False), (False, True), (True, True)])
def test_dark_and_phone(daemon, visit, dark, phone):
    daemon.say(*until(100.0), *then(100.0, 130.0))
    visited = visit(daemon.address, dark=dark, phone=phone)
    waits(visited.page, "document.querySelectorAll('.chart').length === 8")
    waits(visited.page, "document.querySelector('#alarm-lines li')")
    visited.page.wait_for_timeout(600)
    assert visited.overflow_px() <= 0
    assert visited.too_wide() == []
    assert visited.low_contrast() == []
    colour = visited.page.evaluate(
        "app.timeline.plot.xaxis?.[0]?.major_label_text_color ?? app.timeline.plot.below[0]"
        ".major_label_text_color"
    )
    assert ("#a9aeb5" in str(colour)) == dark
    visited.screen(f"live{'-dark' if dark else ''}{'-phone' if phone else ''}")


def test_everything_is_reached_by_tab_and_seen(daemon, visit):
    daemon.say(*until(100.0))
    visited = visit(daemon.address)
    waits(visited.page, "document.querySelectorAll('.chart').length === 8")
    stops = visited.tab_stops()
    assert [stop["tag"] for stop in stops][:5] == ["a", "input", "button", "input", "button"]
    assert all(stop["seen"] for stop in stops), [s for s in stops if not s["seen"]]


def test_ten_minutes_leave_the_memory_flat(daemon, visit):
    """Ten minutes of frames at 10 Hz, fed as fast as they are taken, after two that fill rings."""
    first, _ = until(0.0)
    daemon.say(first | {"rate_hz": 10.0})
    page = visit(daemon.address).page
    waits(page, "app.run === 'example'")
    memory = page.context.new_cdp_session(page)
    numbers = count(10)

    def feed(minutes):
        for _ in range(int(minutes * 60)):
            frames = []
            for _ in range(10):
                number = next(numbers)
                frame = FRAMES[200 + number % 90] | {"number": number, "t_s": number / 10.0}
                frame["changes"] = {"aoa0": [changed(number)]} if number % 50 == 0 else {}
                frames.append(frame)
            daemon.say(*frames)
            daemon.forget()
        last = number / 10.0
        waits(page, f"app.store.t_s >= {last}", 60.0)
        page.wait_for_timeout(500)
        memory.send("HeapProfiler.collectGarbage")
        return page.evaluate("performance.memory.usedJSHeapSize") / 1e6

    feed(5.5)
    before = feed(0.5)
    after = feed(10.0)
    print(f"JavaScript memory: {before:.1f} MB, ten minutes later {after:.1f} MB")
    assert after < before + 2.0, f"{before:.1f} MB before ten minutes, {after:.1f} MB after"
    assert page.evaluate("app.timeline.spans.get('aoa0').length") < 80


def changed(number):
    return {
        "t_s": number / 10.0,
        "state": "suspect" if number % 100 else "ok",
        "reason": None,
        "kind": None,
        "size": None,
        "onset_t_s": None,
        "evidence": "",
    }


def test_every_chart_of_the_catalogue_opens(daemon, visit):
    """A frame that says something of every column brings every chart, without a complaint."""
    everything = FRAMES[400] | {"number": 400}
    for chart in catalogue()["charts"]:
        for line in chart["series"]:
            fill(everything, line["column"])
    daemon.say(*until(79.0), everything)
    page = visit(daemon.address).page
    wanted = len(catalogue()["charts"])
    waits(page, f"app.painter.figures.size === {wanted + 1}", 30.0)
    assert page.locator(".chart").count() == wanted


def fill(frame, column):
    """Let the frame say 1.0 of a column."""
    head, _, rest = column.partition(".")
    if column.endswith(".test"):
        frame.setdefault("tests", {})[column[: -len(".test")]] = 1.0
    elif not rest:
        frame["measured"][column] = (1.0, 1.0)
    else:
        into = frame.setdefault("imu", {}) if head.startswith("imu") else frame
        estimate = into.setdefault(head, {"t_s": 80.0})
        name, _, index = rest.partition(".")
        if index:
            estimate.setdefault(name, [1.0] * 4)
        else:
            estimate[name] = 1.0
