"""Where the shared oracle files and recorded flights are; tests skip where they are absent."""

import os
import tempfile
from collections.abc import Generator
from pathlib import Path

import pytest

from links.logs import TlogWriter
from sim_feeds import player, scenario
from tests.turns import turn

ROOT = Path(__file__).resolve().parents[1]
TURNS = "MAVSENTRY_TEST_TURNS"


@pytest.fixture(scope="session", autouse=True)
def _own_state():
    """What a daemon keeps for its next start is not kept where the user's own one finds it."""
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setenv("STATE_DIRECTORY", folder)
        yield


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--screens", metavar="DIR", help="keep screenshots of the pages in DIR")


def pytest_configure(config: pytest.Config) -> None:
    """Who hands out tests to several processes gives them a place for their locks."""
    if config.getoption("numprocesses", None) and not hasattr(config, "workerinput"):
        folder = tempfile.TemporaryDirectory(prefix="mavsentry-tests-")
        os.environ[TURNS] = folder.name
        config.add_cleanup(folder.cleanup)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Of several processes, that with a test marked ``alone`` has the machine for itself."""
    if (place := os.environ.get(TURNS)) is None:
        return (yield)
    with turn(Path(place, "turns"), alone=item.get_closest_marker("alone") is not None):
        return (yield)


@pytest.fixture(scope="session")
def shared() -> Path:
    """Folder with the algorithm notes, oracle files and flights, beside the checkout."""
    path = Path(os.environ.get("MAVSENTRY_SHARED", ROOT.parent / "shared"))
    if not path.is_dir():
        pytest.skip("the shared folder is not beside this checkout (or set MAVSENTRY_SHARED)")
    return path


@pytest.fixture(scope="session")
def shared_data(shared: Path) -> Path:
    """Folder with the recorded flights."""
    path = Path(os.environ.get("MAVSENTRY_DATA", shared / "data"))
    if not path.is_dir():
        pytest.skip("no recorded flights (set MAVSENTRY_DATA)")
    return path


@pytest.fixture(scope="session")
def oracle(shared: Path) -> Path:
    """Folder with inputs and expected outputs of independent implementations."""
    path = shared / "oracle"
    if not path.is_dir():
        pytest.skip("no oracle folder in the shared folder")
    return path


@pytest.fixture(scope="session")
def blockage_frames() -> list[tuple[int, bytes]]:
    """Frames of a flight of which one pitot breaks, then the other, and their times [us]."""
    return list(player.frames_of(scenario.load("small-uav-pitot-blockage").fly()))


@pytest.fixture(scope="session")
def blockage_log(
    blockage_frames: list[tuple[int, bytes]], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """The same as a telemetry log."""
    file = tmp_path_factory.mktemp("blockage") / "flight.tlog"
    with TlogWriter(file) as writer:
        for t_us, frame in blockage_frames:
            writer.write(frame, 1_700_000_000_000_000 + t_us)
    return file
