"""The public surface: what is in it, that it is described, and that it does not change unseen."""

from __future__ import annotations

import ast
import inspect
import re
import subprocess
import sys
import tomllib
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import monitor

ROOT = Path(__file__).parents[2]
MOST = 30
"""Names that a small surface has at most."""


@pytest.fixture(scope="module")
def names() -> ModuleType:
    spec = spec_from_file_location("api_names", ROOT / "docs" / "api_names.py")
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_surface_is_small_sorted_and_there() -> None:
    assert len(monitor.__all__) <= MOST
    assert len(set(monitor.__all__)) == len(monitor.__all__)
    assert all(getattr(monitor, name) is not None for name in monitor.__all__)
    assert set(monitor.__all__) <= set(dir(monitor))
    with pytest.raises(AttributeError, match="no attribute 'Pipline'"):
        monitor.Pipline  # noqa: B018


def test_type_checkers_see_what_is_loaded() -> None:
    tree = ast.parse((ROOT / "monitor" / "__init__.py").read_text(encoding="utf-8"))
    (block,) = [node for node in tree.body if isinstance(node, ast.If)]
    seen = {
        alias.asname or alias.name: (node.module, alias.name)
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert seen == monitor._PLACES
    assert {*seen, "__version__"} == set(monitor.__all__)


def test_the_package_alone_loads_no_numerics() -> None:
    code = "import sys, monitor; monitor.__version__; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"numpy", "numba", "pydantic", "pymavlink"} & set(done.stdout.split())


@pytest.mark.parametrize("room", ["monitor", "links", "estimators", "sim_feeds"])
def test_the_packages_say_that_they_are_typed(room: str) -> None:
    assert (ROOT / room / "py.typed").is_file()


def test_all_of_it_is_described(names: ModuleType) -> None:
    public = {name: getattr(monitor, name) for name in monitor.__all__}
    missing = [what for name, thing in public.items() for what in names.undescribed(name, thing)]
    assert missing == []
    assert sum(names.countable(name, thing) for name, thing in public.items()) > 100


def test_what_lacks_a_description_is_seen(names: ModuleType) -> None:
    class Bare:
        """Does something."""

        def __init__(self, speed: float) -> None: ...

        def silent(self) -> None: ...

        def vague(self, one: int, other: int) -> None:
            """Do something with both."""

    assert names.undescribed("Bare", Bare) == [
        "Bare.silent",
        "Bare.vague(one)",
        "Bare.vague(other)",
        "Bare(speed)",
    ]


def test_the_page_has_every_name_as_the_code_has_it(names: ModuleType) -> None:
    grouped = [name for group in names.GROUPS.values() for name in group]
    assert sorted(grouped) == sorted(monitor.__all__)
    page = names.PAGE.read_text(encoding="utf-8")
    assert page == names.filled(page), (
        "the public surface has changed: say so in CHANGELOG.md, keep what docs/api.md promises, "
        "then run `python docs/api_names.py`"
    )
    assert "class '" not in page
    assert " at 0x" not in page


def test_signatures_speak_of_nothing_that_is_not_public(names: ModuleType) -> None:
    page = names.PAGE.read_text(encoding="utf-8").partition("<!-- names -->")[2]
    signatures = re.findall(r"^```text\n(.*)\n```|^\* `(\w+(?:\(.*\).*|: .*))`:", page, re.M)
    assert len(signatures) > 15
    spoken = set(re.findall(r"\b[A-Z]\w+", " ".join(map("".join, signatures))))
    others = {"Any", "ArrayLike", "Callable", "Counter", "Iterable", "Mapping", "None", "Path"}
    assert spoken <= {*monitor.__all__, *others}


@pytest.mark.parametrize("module", ["two_stage_ekf", "triplex", "imkf", "monotone_map"])
def test_estimators_to_be_used_alone_are_described(names: ModuleType, module: str) -> None:
    assert f"`estimators.{module}`" in names.PAGE.read_text(encoding="utf-8")
    there: Any = __import__(f"estimators.{module}", fromlist=["__all__"])
    things = {name: getattr(there, name) for name in there.__all__}
    made = {n: t for n, t in things.items() if inspect.isroutine(t) or inspect.isclass(t)}
    assert made
    assert [n for n, t in made.items() if not (t.__doc__ or "").strip()] == []


def test_the_version_is_that_of_the_changelog() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    heads = [
        line.removeprefix("## ")
        for line in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").splitlines()
        if line.startswith("## ")
    ]
    assert heads[0] == "[Unreleased]"
    version, _, date = heads[1].partition(" - ")
    assert version == f"[{project['version']}]"
    assert np.datetime64(date) >= np.datetime64("2026-01-01")
