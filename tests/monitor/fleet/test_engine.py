"""Engines: every task comes to one end, whatever becomes of the others."""

from __future__ import annotations

import logging
import os
import signal
import time
from collections.abc import Iterator
from itertools import pairwise

import distributed
import pytest

from monitor.fleet import cluster
from monitor.fleet.cluster import AHEAD, alone
from monitor.fleet.engine import Died, Ended, Engine, EngineError, open_engine


@pytest.fixture(scope="module")
def two_workers() -> Iterator[Engine]:
    with open_engine(2) as engine:
        yield engine


@pytest.fixture
def here() -> Iterator[Engine]:
    with open_engine(0) as engine:
        yield engine


def by_item(ended: Iterator[Ended]) -> dict:
    found = list(ended)
    assert len({e.item for e in found}) == len(found)
    return {e.item: e.result if e.error is None else e.error for e in found}


def test_here_tasks_end_in_their_order_and_a_mistake_is_one_task_s(here) -> None:
    def inverse(x: int) -> float:
        return 1.0 / x

    ended = list(here.run(inverse, [1, 0, 2]))
    assert [e.item for e in ended] == [1, 0, 2]
    assert [e.result for e in ended] == [1.0, None, 0.5]
    assert isinstance(ended[1].error, ZeroDivisionError)


def test_here_a_task_that_raised_is_tried_again(here) -> None:
    tries = []

    def third(_: int) -> int:
        tries.append(1)
        if len(tries) < 3:
            raise OSError("not yet")
        return len(tries)

    assert by_item(here.run(third, [7], retries=2)) == {7: 3}
    tries.clear()
    assert isinstance(by_item(here.run(third, [7], retries=1))[7], OSError)


def test_a_task_that_kills_its_workers_is_blamed_and_no_other(two_workers) -> None:
    def deadly(x: int) -> int:
        if x == 3:
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(0.02)
        return x * x

    ended = by_item(two_workers.run(deadly, range(12)))
    assert isinstance(ended.pop(3), Died)
    assert ended == {x: x * x for x in range(12) if x != 3}


def test_a_worker_that_is_killed_once_loses_nothing(two_workers, tmp_path) -> None:
    def once(x: int) -> int:
        if x == 5 and not (tmp_path / "killed").exists():
            (tmp_path / "killed").touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return x + 1

    assert by_item(two_workers.run(once, range(10))) == {x: x + 1 for x in range(10)}
    assert (tmp_path / "killed").exists()


def test_a_worker_that_does_not_come_back_is_replaced(tmp_path, monkeypatch) -> None:
    """Dask gives up one whose start takes long, as on a busy computer."""
    monkeypatch.setitem(cluster._CONFIGURATION, "distributed.deploy.lost-worker-timeout", "1ms")
    monkeypatch.setattr(cluster, "MEND_S", 0.2)
    monkeypatch.setattr(cluster, "WITHOUT_WORKERS_S", 30.0)

    def once(x: int) -> int:
        if not (tmp_path / "killed").exists():
            (tmp_path / "killed").touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return x

    with open_engine(1) as engine:
        assert by_item(engine.run(once, range(3))) == {x: x for x in range(3)}


def test_a_worker_has_one_numeric_thread(two_workers) -> None:
    def threads(_: int) -> tuple[str | None, ...]:
        return tuple(os.environ.get(f"{k}_NUM_THREADS") for k in ("NUMBA", "OMP", "OPENBLAS"))

    assert by_item(two_workers.run(threads, [0])) == {0: ("1", "1", "1")}


def test_tasks_are_taken_as_there_is_room_for_them(two_workers) -> None:
    taken = 0

    def items() -> Iterator[int]:
        nonlocal taken
        while taken < 100:
            taken += 1
            yield taken

    ends = two_workers.run(lambda x: x, items())
    next(ends)
    assert taken <= AHEAD * two_workers.workers + 1
    ends.close()


def test_within_one_name_there_is_one_task_at_a_time(two_workers) -> None:
    def interval(_: int) -> tuple[float, float]:
        with alone("the same"):
            began = time.time()
            time.sleep(0.05)
            return began, time.time()

    spans = sorted(by_item(two_workers.run(interval, range(4))).values())
    assert all(later[0] >= earlier[1] for earlier, later in pairwise(spans))


def test_a_scheduler_that_does_not_answer_is_said(monkeypatch) -> None:
    monkeypatch.setattr("monitor.fleet.cluster.CONNECT_S", 0.5)
    answers = pytest.raises(EngineError, match=r"no scheduler answers at tcp://127\.0\.0\.1:9")
    with answers, open_engine(scheduler="tcp://127.0.0.1:9"):
        pass


@pytest.mark.parametrize("address", ["nonsense", "tcp://host", "carrier-pigeon://host:1"])
def test_what_is_no_address_is_said(address) -> None:
    answers = pytest.raises(EngineError, match=f"no scheduler answers at {address}: ")
    with answers, open_engine(scheduler=address):
        pass


@pytest.fixture
def standing() -> Iterator[distributed.LocalCluster]:
    """A scheduler with one worker, in this process, reached over TCP."""
    quiet = {"n_workers": 1, "threads_per_worker": 1, "processes": False, "protocol": "tcp://"}
    with distributed.LocalCluster(
        **quiet,
        host="127.0.0.1",
        dashboard_address=None,
        scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
        silence_logs=logging.CRITICAL,
    ) as made:
        yield made


def test_a_scheduler_that_stands_lends_its_workers(standing) -> None:
    with open_engine(scheduler=standing.scheduler_address) as engine:
        assert engine.workers == 1
        assert by_item(engine.run(lambda x: x * x, range(5))) == {x: x * x for x in range(5)}
    assert standing.status.name == "running"


def test_a_scheduler_without_workers_is_said(standing, monkeypatch) -> None:
    with open_engine(scheduler=standing.scheduler_address) as engine:
        standing.scale(0)
        while engine.workers:
            time.sleep(0.05)
        monkeypatch.setattr("monitor.fleet.cluster.WITHOUT_WORKERS_S", 0.2)
        monkeypatch.setattr("monitor.fleet.cluster.POLL_S", 0.1)
        with pytest.raises(EngineError, match="no worker was left"):
            list(engine.run(lambda x: x, [1]))
    refused = pytest.raises(EngineError, match="has no worker")
    with refused, open_engine(scheduler=standing.scheduler_address):
        pass


def test_a_scheduler_that_goes_is_said(standing, monkeypatch) -> None:
    monkeypatch.setattr("monitor.fleet.cluster.CONNECT_S", 1.0)

    def slow(x: int) -> int:
        time.sleep(0.2)
        return x

    with open_engine(scheduler=standing.scheduler_address) as engine:
        ends = engine.run(slow, range(50))
        next(ends)
        standing.close()
        with pytest.raises(EngineError, match="the connection to the scheduler is lost"):
            list(ends)
