"""The pictures are those that the code draws today, and pages show them."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

DOCS = Path(__file__).parents[2] / "docs"
PICTURES = DOCS / "pictures"
PHOTOGRAPHS = {"live.png", "report.png"}
"""Of pages in a browser; ``tests/browser`` keeps those."""


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pictures")
    command = [sys.executable, str(DOCS / "pictures.py"), "--to", str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=DOCS.parent)
    assert done.returncode == 0, done.stderr
    return folder


def test_every_picture_is_drawn_by_code(drawn: Path) -> None:
    kept = {p.name for p in PICTURES.glob("*.png")} - PHOTOGRAPHS
    assert kept == {p.name for p in drawn.iterdir()}


def test_pictures_are_up_to_date(drawn: Path) -> None:
    from matplotlib.image import imread

    for new in drawn.iterdir():
        old = imread(PICTURES / new.name)[..., :3]
        now = imread(new)[..., :3]
        assert old.shape == now.shape, f"run python docs/pictures.py {new.name}"
        differs = np.mean(np.abs(old - now).max(axis=2) > 0.2)
        assert differs < 0.01, f"{differs:.1%} differ: run python docs/pictures.py {new.name}"


def test_pages_show_every_picture_in_words_too() -> None:
    pages = [DOCS.parent / "README.md", *DOCS.rglob("*.md")]
    shown = {
        (page.parent / target).resolve().name: words
        for page in pages
        if "_build" not in page.parts
        for words, target in re.findall(r"!\[([^\]]*)\]\(([^)]+\.png)\)", page.read_text("utf-8"))
    }
    assert {p.name for p in PICTURES.glob("*.png")} <= shown.keys()
    assert all(len(words) > 20 for words in shown.values())
