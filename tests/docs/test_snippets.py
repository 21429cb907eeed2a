"""What the pages show is what happens: each page's commands and files, run and read."""

from __future__ import annotations

import os
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.docs.elsewhere import REASONS
from tests.docs.pages import paths, read
from tests.docs.running import Running
from tests.docs.session import Session
from tests.docs.warm import Warm

PAGES = paths()


@pytest.fixture(scope="module")
def warm() -> Iterator[Warm]:
    with tempfile.TemporaryDirectory(prefix="ms-") as folder:
        warm = Warm(Path(folder))
        yield warm
        warm.close()


@pytest.fixture(scope="module")
def flights(tmp_path_factory) -> Path:
    """One folder for all processes of a run."""
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "docs-flights"
    folder.mkdir(exist_ok=True)
    return folder


@pytest.fixture(scope="module")
def data() -> Path | None:
    shared = Path(os.environ.get("MAVSENTRY_SHARED", ROOT.parent / "shared"))
    folder = Path(os.environ.get("MAVSENTRY_DATA", shared / "data"))
    return folder if folder.is_dir() else None


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_snippets_of_the_page_are_true(path, warm, flights, data, tmp_path):
    page = read(path)
    running = Running(page, Session(tmp_path, warm.programs), flights, data)
    wrong = running.whole()
    if wrong:
        pytest.fail("\n\n".join(wrong), pytrace=False)


def test_what_runs_elsewhere_is_counted_and_the_smaller_part():
    reasons: Counter[str] = Counter()
    run = 0
    for path in PAGES:
        for fence in read(path).fences():
            if fence.language not in ("console", "python", "sql"):
                continue
            if "elsewhere" in fence.says:
                reasons[fence.says["elsewhere"]] += 1
            else:
                run += 1
    print(f"\n{run} fences are run; elsewhere: {dict(reasons)}")
    assert set(reasons) <= set(REASONS)
    assert run > reasons.total()
