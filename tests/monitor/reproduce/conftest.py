"""The quick version of every paper, done once for all tests of this folder and all processes."""

import fcntl
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from monitor.commands.reproduce.engine import run_jobs
from monitor.commands.reproduce.papers import paper_of
from monitor.commands.reproduce.store import Store
from monitor.commands.reproduce.study import Chapter, Results, Scope
from tests.turns import locked

QUICK = Scope(quick=True)


@pytest.fixture(scope="session")
def quick_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What ``reproduce --quick --out`` is given; its results are those of :func:`quickly`."""
    if "PYTEST_XDIST_WORKER" not in os.environ:
        return tmp_path_factory.mktemp("papers")
    folder = tmp_path_factory.getbasetemp().parent / "papers"
    folder.mkdir(exist_ok=True)
    return folder


@pytest.fixture(scope="session")
def quickly(quick_dir: Path) -> Callable[[str], tuple[Results, Chapter]]:
    """A function of a paper's key: results and chapter of its quick version, computed once."""
    found: dict[str, tuple[Results, Chapter]] = {}

    def run(key: str) -> tuple[Results, Chapter]:
        if key not in found:
            paper, store = paper_of(key), Store(quick_dir / "results-quick")
            with locked(str(quick_dir / f"{key}.lock")) as lock:
                fcntl.flock(lock, fcntl.LOCK_EX)
                results = run_jobs(paper.jobs(QUICK), store, 1, lambda fraction: None).results[key]
            found[key] = results, paper.chapter(results, QUICK)
        return found[key]

    return run
