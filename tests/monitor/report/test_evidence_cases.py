"""Which findings share charts, and which time those show."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.report.evidence_cases import (
    FULL,
    MORE_KEY,
    Case,
    anchors,
    cases_of,
    chosen,
    groups_of,
    window_of,
)
from tests.monitor.report.summaries import fault, summary

END_S = 3600.0
times = st.floats(0.0, 400.0)


def case(onset_s: float, isolated_s: float, cleared_s: float | None = None, **more: Any) -> Case:
    found = {"kind": "bias"} | more
    return Case("airspeed0", onset_s, isolated_s, isolated_s, cleared_s, found)


@given(onset_s=st.floats(0.0, END_S - 401.0), delay_s=times, lasts_s=st.none() | times)
def test_the_window_holds_onset_and_verdict(
    onset_s: float, delay_s: float, lasts_s: float | None
) -> None:
    isolated_s = onset_s + delay_s
    one = case(onset_s, isolated_s, None if lasts_s is None else isolated_s + lasts_s)
    from_s, to_s = window_of(one, END_S)
    assert 0.0 <= from_s <= onset_s <= isolated_s <= to_s <= END_S
    assert onset_s - from_s >= min(12.0, onset_s) - 1e-9  # enough to see that they agreed
    assert to_s - isolated_s >= min(15.0, END_S - isolated_s) - 1e-9
    assert 30.0 - 1e-9 <= to_s - from_s <= 2.5 * (delay_s + 240.0)


def test_a_clearing_is_shown_if_it_is_near() -> None:
    near, far = case(100.0, 101.0, 140.0), case(100.0, 101.0, 400.0)
    assert window_of(near, END_S)[1] == pytest.approx(145.0)
    assert window_of(far, END_S)[1] == pytest.approx(118.0)  # half a minute


@pytest.mark.parametrize(("onset_s", "isolated_s"), [(0.4, 2.4), (298.0, 299.5)])
def test_at_the_ends_of_a_log_half_a_minute_is_shown_all_the_same(
    onset_s: float, isolated_s: float
) -> None:
    from_s, to_s = window_of(case(onset_s, isolated_s), 300.0)
    assert to_s - from_s >= 27.0
    assert 0.0 <= from_s <= onset_s
    assert isolated_s <= to_s <= 300.0


def test_a_log_shorter_than_a_window() -> None:
    assert window_of(case(3.0, 4.0), 8.0) == (0.0, 8.0)


def test_a_sensor_that_fails_again_in_view_shares_the_charts() -> None:
    found = [fault("airspeed0", at_s, at_s + 1.0) for at_s in (100.0, 120.0, 300.0)]
    found.append(fault("airspeed1", 121.0, 122.0))
    groups = groups_of(cases_of(summary(faults=found, events=[])), END_S)
    assert [[c.onset_s for c in g.cases] for g in groups] == [[100.0, 120.0], [121.0], [300.0]]
    assert (groups[0].from_s, groups[0].to_s) == (88.0, 138.0)


def test_a_sensor_that_fails_without_end_gets_several_sections() -> None:
    found = [fault("airspeed0", 20.0 * k, 20.0 * k + 1.0) for k in range(1, 60)]
    groups = groups_of(cases_of(summary(faults=found, events=[])), END_S)
    assert len(groups) > 3
    assert all(g.to_s - g.from_s <= 240.0 for g in groups)
    assert sum(len(g.cases) for g in groups) == len(found)


@pytest.mark.parametrize(("kind", "sections"), [("dropout", 1), ("stuck", 1), ("bias", 6)])
def test_the_axes_of_a_dead_imu_share_a_section(kind: str, sections: int) -> None:
    axes = ("acc_x", "acc_y", "acc_z", "gyro_x", "gyro_y", "gyro_z")
    found = [fault(f"imu0.{axis}", 50.0, 50.6, kind=kind) for axis in axes]
    groups = groups_of(cases_of(summary(faults=found, events=[])), END_S)
    assert len(groups) == sections
    assert len(groups[0].sensors) == 6 // sections


def test_every_sensors_first_failure_is_drawn_before_any_second() -> None:
    found = [fault("airspeed0", 300.0 * k, 300.0 * k + 1.0) for k in range(1, 9)]
    found.append(fault("aoa0", 2500.0, 2501.0))
    drawn = chosen(groups_of(cases_of(summary(faults=found, events=[])), END_S), 3)
    assert [(g.sensor, g.cases[0].onset_s) for g in drawn] == [
        ("airspeed0", 300.0),
        ("airspeed0", 600.0),
        ("aoa0", 2500.0),
    ]


def test_every_finding_has_an_anchor() -> None:
    found = [fault("airspeed0", 100.0 * k, 100.0 * k + 1.0) for k in range(1, 30)]
    found.insert(1, fault("airspeed0", 115.0, 116.0))  # in view of the first
    event = {"what": "engine0", "onset_s": 90.0, "detected_s": 95.0, "ended_s": None}
    at = anchors(summary(faults=found, events=[event]), END_S)
    assert set(at) == {f"fault-{k + 1}" for k in range(30)} | {"event-1"}
    assert at["fault-1"] == at["fault-2"] == "fault-1"
    assert at["event-1"] == "event-1"
    drawn = {anchor for anchor in at.values() if anchor != MORE_KEY}
    assert len(drawn) == FULL
    assert at["fault-30"] == MORE_KEY


def test_findings_stand_in_order_of_detection() -> None:
    event = {"what": "engine0", "onset_s": 90.0, "detected_s": 95.0, "ended_s": None}
    found = [fault("airspeed0", 10.0, 97.0), fault("aoa0", 80.0, 81.0)]
    cases = cases_of(summary(faults=found, events=[event]))
    assert [(c.key, c.sensor, c.is_event) for c in cases] == [
        ("fault-2", "aoa0", False),
        ("event-1", "engine0", True),
        ("fault-1", "airspeed0", False),
    ]
