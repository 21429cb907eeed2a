"""Where the shared oracle files and recorded flights are; tests skip where they are absent."""

import os
import tempfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session", autouse=True)
def _own_state():
    """What a daemon keeps for its next start is not kept where the user's own one finds it."""
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setenv("STATE_DIRECTORY", folder)
        yield


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--screens", metavar="DIR", help="keep screenshots of the pages in DIR")


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
