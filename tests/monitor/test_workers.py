"""Work in several processes: the items' order, one that dies, and how far it is."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Sequence
from pathlib import Path

import pytest

from monitor.commands.workers import Died, Tell, work


def double(item: int, tell: Tell) -> int:
    tell(item)
    return 2 * item


def slow_first(item: int, tell: Tell) -> tuple[int, int]:
    time.sleep(0.3 if item == 0 else 0.0)
    return item, os.getpid()


def killed(item: str, tell: Tell) -> str:
    if item == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    if item == "leave":
        os._exit(3)
    return item


def asleep(item: Path, tell: Tell) -> None:
    item.write_text(str(os.getpid()))
    time.sleep(60.0)


def ignored(done: Sequence[int]) -> None:
    pass


@pytest.mark.parametrize("jobs", [1, 2])
def test_results_come_in_the_order_of_the_items(jobs: int) -> None:
    assert list(work(double, range(7), jobs, ignored)) == [0, 2, 4, 6, 8, 10, 12]


def test_a_slow_item_keeps_no_other_waiting() -> None:
    results = list(work(slow_first, [0, 1, 2, 3], 2, ignored))
    assert [item for item, _ in results] == [0, 1, 2, 3]
    processes = {process for _, process in results}
    assert len(processes) == 2
    assert os.getpid() not in processes
    assert results[0][1] not in {process for _, process in results[1:]}


def test_a_process_that_dies_costs_its_item_alone() -> None:
    items = ["a", "kill", "b", "leave", "c", "kill", "d"]
    dead = Died(signal.SIGKILL)
    assert list(work(killed, items, 2, ignored)) == ["a", dead, "b", Died(None), "c", dead, "d"]


def test_it_is_told_how_much_is_done() -> None:
    told: list[int] = []
    list(work(double, [3, 4], 1, lambda done: told.append(sum(done))))
    assert told == [3, 7]
    told.clear()
    list(work(double, [3, 4], 2, lambda done: told.append(sum(done))))
    assert told == sorted(told)
    assert max(told) == 7


def test_who_stops_listening_ends_the_processes(tmp_path: Path) -> None:
    notes = [tmp_path / "0", tmp_path / "1", tmp_path / "2"]
    notes[0].write_text("")

    results = work(quick_then_asleep, notes, 2, ignored)
    assert next(results) is None
    deadline = time.monotonic() + 20.0
    while not (notes[1].exists() and notes[1].read_text()) and time.monotonic() < deadline:
        time.sleep(0.02)
    results.close()  # type: ignore[attr-defined]
    with pytest.raises(ProcessLookupError):
        os.kill(int(notes[1].read_text()), 0)


def quick_then_asleep(item: Path, tell: Tell) -> None:
    if item.name != "0":
        asleep(item, tell)
