"""The pipeline routes, orders, and composes states; fakes stand for the watches."""

from collections.abc import Mapping

import numpy as np
import pytest

from links.samples import Batch, Rows, empty_rows
from links.vocabulary import Reason, State
from monitor.pipeline import Pipeline
from monitor.settings import Settings
from monitor.verdict import StepResult, Verdict


class EveryTenthRow:
    """Says ``ok`` at an IMU's first row and ``faulty`` at each tenth; records what it was given."""

    name = "fake"
    quantities = frozenset({"imu", "gps"})

    def __init__(self) -> None:
        self.seen: list[tuple[str, int]] = []
        self.count = 0

    def step(self, rows: Mapping[str, Rows], until_us: int) -> StepResult:
        out = StepResult()
        for sensor, new in rows.items():
            assert (new["t_us"] < until_us).all()
            self.seen += [(sensor, int(t)) for t in new["t_us"]]
        for t_us in rows.get("imu0", empty_rows("imu0"))["t_us"]:
            if self.count == 0:
                out.verdicts.append(Verdict(int(t_us), "imu0.acc_x", State.OK))
            self.count += 1
            if self.count % 10 == 0:
                out.verdicts.append(Verdict(int(t_us), "imu0.acc_x", State.FAULTY))
        return out


def imu(times_s: np.ndarray, first_seq: int = 0) -> Batch:
    rows = empty_rows("imu0", len(times_s))
    rows["t_us"] = times_s * 1e6
    rows["acc_m_s2"][:, 2] = -9.8
    rows["seq"] = first_seq + np.arange(len(times_s))
    return Batch({"imu0": rows})


@pytest.fixture
def pipeline() -> Pipeline:
    return Pipeline(Settings(), watches=[EveryTenthRow()])


def test_rows_wait_for_the_horizon_and_finish_releases_the_rest(pipeline: Pipeline) -> None:
    assert pipeline.feed(imu(np.array([1.0, 1.1]))).verdicts == []
    assert [v.state for v in pipeline.feed(imu(np.array([1.6]), 2)).verdicts] == [State.OK]
    pipeline.finish()
    assert pipeline.streams["imu0"].samples == 3


def test_a_stopped_stream_is_stale_and_comes_back_with_what_was_judged(pipeline: Pipeline) -> None:
    times = np.concatenate((np.arange(0, 1.2, 0.1), [5.0, 5.1, 9.0]))
    verdicts = pipeline.feed(imu(times)).verdicts + pipeline.finish().verdicts
    assert [(v.t_us / 1e6, v.state) for v in verdicts] == [
        (0.0, State.OK),
        (0.9, State.FAULTY),
        (2.1, State.STALE),
        (5.0, State.FAULTY),
        (6.1, State.STALE),
        (9.0, State.FAULTY),
    ]


def test_the_same_verdicts_for_any_split() -> None:
    times = np.concatenate((np.arange(0, 3, 0.02), np.arange(6, 9, 0.03)))
    whole = Pipeline(Settings(), watches=[EveryTenthRow()])
    expected = whole.feed(imu(times)).verdicts + whole.finish().verdicts
    for size in (1, 7, 60):
        parts = Pipeline(Settings(), watches=[EveryTenthRow()])
        got = [
            v for b in imu(times).split(range(0, len(times), size)) for v in parts.feed(b).verdicts
        ]
        assert got + parts.finish().verdicts == expected


def test_references_have_a_state_and_spools_a_reason_on_the_ground() -> None:
    pipeline = Pipeline(Settings())
    gps, spool = empty_rows("gps0", 1), empty_rows("spool0", 2)
    spool["t_us"], spool["seq"] = (0, 200_000), (1, 2)
    pipeline.feed(Batch({"gps0": gps, "spool0": spool}))
    pipeline.finish()
    assert pipeline.states()["gps0"].state is State.OK
    assert pipeline.states()["spool0"].reason is Reason.ON_GROUND


def test_gps_rows_are_given_at_their_validity_time() -> None:
    watch = EveryTenthRow()
    settings = Settings()
    pipeline = Pipeline(settings, watches=[watch])
    gps = empty_rows("gps0", 1)
    gps["t_us"] = 2_000_000
    pipeline.feed(Batch({"gps0": gps}))
    pipeline.finish()
    latency_us = round(settings.streams.gps_latency_s * 1e6)
    assert watch.seen == [("gps0", 2_000_000 - latency_us)]


def test_a_boot_behind_what_was_released_does_not_turn_time_back() -> None:
    """Stamps that run ahead of the clock can carry rows past the moment of a reboot."""

    class Content(EveryTenthRow):
        def step(self, rows, until_us):
            said = [] if self.count else [Verdict(0, "imu0.acc_x", State.OK)]
            self.count = 1
            return StepResult(said)

    pipeline = Pipeline(Settings(), watches=[Content()])
    rows = empty_rows("gps0", 200)
    rows["seq"], rows["t_us"] = np.arange(200), np.arange(200) * 100_000
    rows["vel_ned_m_s"][:, 0], rows["fix_type"] = 20.0, 3
    pipeline.feed(Batch({"gps0": rows}))
    assert pipeline.flying
    released_us = pipeline.now_us
    standing = rows.copy()
    standing["seq"] += 200
    standing["t_us"] += 20_000_000
    standing["vel_ned_m_s"] = 0.0
    told = pipeline.feed(Batch({"gps0": standing}, boots=(5_000_000,))).verdicts
    assert (told[0].t_us, told[0].sensor) == (released_us, "imu0.acc_x")
    assert told[0].reason is Reason.REFERENCE_MISSING
