"""The pictures of the architecture are those of the code, and show the imports that there are."""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).parents[2]
ROOMS = ("monitor", "links", "estimators", "sim_feeds")


@pytest.fixture(scope="module")
def architecture():
    sys.path.insert(0, str(ROOT / "docs"))
    try:
        import architecture
    finally:
        sys.path.remove(str(ROOT / "docs"))
    return architecture


@pytest.fixture(scope="module")
def imports() -> set[tuple[str, str]]:
    """(importer, imported) of modules in different rooms."""
    graph = grimp.build_graph(*ROOMS, cache_dir=None)
    return {
        (module, target)
        for module in graph.modules
        for target in graph.find_modules_directly_imported_by(module)
        if module.partition(".")[0] != target.partition(".")[0]
    }


def test_the_files_are_what_the_code_draws(architecture) -> None:
    for file, draw in architecture.PICTURES.items():
        kept = (ROOT / "docs" / "pictures" / file).read_text("utf-8")
        assert kept == draw(), f"{file} is old: python docs/architecture.py"


def test_the_arrows_are_the_imports_between_the_rooms(architecture, imports) -> None:
    assert {(a.partition(".")[0], b.partition(".")[0]) for a, b in imports} == set(
        architecture.ARROWS
    )


def test_a_dashed_arrow_is_of_the_named_modules_only(architecture, imports) -> None:
    named = set(architecture.commands_with_feeds())
    feeding = {a for a, b in imports if a.startswith("monitor") and b.startswith("sim_feeds")}
    assert {module.split(".")[2] for module in feeding} <= named
    borrowing = {(a, b) for a, b in imports if a.startswith("estimators")}
    assert borrowing == {("estimators.jit", "links.jit")}


def test_the_page_says_every_contract() -> None:
    rules = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]
    page = (ROOT / "docs" / "developing" / "architecture.md").read_text("utf-8")
    for contract in rules["contracts"]:
        assert contract["name"] in page
