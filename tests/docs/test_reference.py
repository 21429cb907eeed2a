"""The pages made from the program say what the program is now."""

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

from monitor.settings.explained import keys_of

DOCS = Path(__file__).resolve().parents[2] / "docs"


def reference() -> ModuleType:
    spec = importlib.util.spec_from_file_location("docs_reference", DOCS / "reference.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", ["commands.md", "configuration.md"])
def test_the_page_is_what_the_program_says(name: str) -> None:
    made = reference().PAGES[name]()
    assert (DOCS / name).read_text(encoding="utf-8") == made, "python docs/reference.py mends it"


def test_every_key_of_the_settings_is_on_the_page() -> None:
    text = (DOCS / "configuration.md").read_text(encoding="utf-8")
    missing = [
        key.name for key, _ in keys_of() if f"**`{key.name.rpartition('.')[2]}`**" not in text
    ]
    assert not missing


def test_every_key_says_what_it_is() -> None:
    assert not [key.name for key, _ in keys_of() if not key.meaning.endswith((".", "?"))]
