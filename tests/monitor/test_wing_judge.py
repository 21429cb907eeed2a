"""The judgement of the wings on rows of estimates that are given."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimators.wing_stream import WingRun
from links.vocabulary import Kind, Reason, State
from monitor.settings.wing import WingSettings
from monitor.verdict import Verdict
from monitor.watch.wing_judge import WingJudge

PERIOD_S = WingSettings().period_s
RIGHT_LIFT = "wing_right.lift"


def rows(
    from_s: float,
    to_s: float,
    lost: NDArray[np.float64] | float,
    std: float = 1.0,
    unlike: float = 0.1,
) -> WingRun:
    """Rows in which the right wing has lost so much lift."""
    t_s = np.arange(from_s, to_s, PERIOD_S)
    f = np.zeros((len(t_s), 4))
    f[:, 0] = lost
    return WingRun(
        t_s,
        f,
        np.full((len(t_s), 6), std),
        np.full((len(t_s), 2), 0.3),
        np.ones(len(t_s), bool),
        np.full(len(t_s), unlike),
    )


def of(verdicts: list[Verdict], sensor: str = RIGHT_LIFT) -> list[Verdict]:
    return [v for v in verdicts if v.sensor == sensor]


def test_nothing_is_judged_before_the_airframe_is_known_to_fit() -> None:
    judge = WingJudge(WingSettings())
    said = of(judge.judge(rows(0.0, 9.5, 8.0), 0))
    assert [v.reason for v in said] == [Reason.LEARNING]
    said = of(judge.judge(rows(9.5, 12.0, 8.0), 0))
    assert [v.state for v in said] == [State.FAULTY]


def test_once_a_wing_is_damaged_the_airframe_is_not_asked() -> None:
    judge = WingJudge(WingSettings())
    judge.judge(rows(0.0, 20.0, 0.0), 0)
    assert [v.state for v in of(judge.judge(rows(20.0, 25.0, 8.0), 0))] == [State.FAULTY]
    assert not judge.judge(rows(25.0, 60.0, 8.0, unlike=1e4), 0)


def test_nor_after_two_minutes() -> None:
    judge = WingJudge(WingSettings())
    judge.judge(rows(0.0, 120.0, 0.0), 0)
    assert not judge.judge(rows(120.0, 200.0, 0.0, unlike=1e4), 0)
    other = WingJudge(WingSettings())
    other.judge(rows(0.0, 119.0, 0.0), 0)
    assert [v.reason for v in of(other.judge(rows(119.0, 120.0, 0.0, unlike=1e4), 0))] == [
        Reason.AIRFRAME_MISFIT
    ]


def test_a_damaged_wing_told_again_keeps_its_onset_and_kind() -> None:
    judge = WingJudge(WingSettings())
    judge.judge(rows(0.0, 20.0, 0.0), 0)
    first = of(judge.judge(rows(20.0, 400.0, 8.0), 0))[0]
    assert first.kind is Kind.BIAS
    judge.cannot(400_000_000, Reason.REFERENCE_MISSING, "missing: velocity")
    again = of(judge.judge(rows(410.0, 420.0, 8.0), 0))[0]
    assert again.state is State.FAULTY
    assert (again.onset_t_us, again.kind) == (first.onset_t_us, first.kind)


def test_a_wing_that_was_whole_again_has_a_new_onset() -> None:
    judge = WingJudge(WingSettings())
    judge.judge(rows(0.0, 20.0, 0.0), 0)
    first = of(judge.judge(rows(20.0, 60.0, 8.0), 0))[0]
    assert [v.state for v in of(judge.judge(rows(60.0, 120.0, 0.0), 0))] == [State.OK]
    second = of(judge.judge(rows(120.0, 130.0, 8.0), 0))[0]
    assert first.onset_t_us is not None
    assert second.onset_t_us is not None
    assert second.onset_t_us >= first.onset_t_us + 99_000_000


def test_an_infinite_deviation_is_no_ok() -> None:
    judge = WingJudge(WingSettings())
    assert of(judge.judge(rows(0.0, 20.0, 0.0), 0))[-1].state is State.OK
    said = of(judge.judge(rows(20.0, 30.0, 0.0, std=np.inf), 0))
    assert [v.state for v in said] == [State.UNMONITORED]
    assert said[0].reason is Reason.REFERENCE_NOT_TRUSTED
    assert [v.state for v in of(judge.judge(rows(30.0, 40.0, 0.0), 0))] == [State.OK]


def test_nor_does_it_make_a_wing_whole() -> None:
    judge = WingJudge(WingSettings())
    judge.judge(rows(0.0, 20.0, 0.0), 0)
    judge.judge(rows(20.0, 30.0, 8.0), 0)
    judge.judge(rows(30.0, 90.0, 0.0, std=np.inf), 0)
    assert [v.state for v in of(judge.judge(rows(90.0, 95.0, 8.0), 0))] == [State.FAULTY]
