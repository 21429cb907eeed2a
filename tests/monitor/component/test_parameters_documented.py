"""The page on parameters says what the code does."""

from __future__ import annotations

import re
from pathlib import Path

from monitor.component.parameters import APPLY_US
from monitor.component.tunables import RESET, TUNABLES, Refusal, Tunable
from monitor.retune import value_of
from monitor.settings import Settings
from monitor.settings.component import ComponentSettings

PAGE = Path(__file__).parents[3] / "docs" / "parameters.md"


def row(tunable: Tunable) -> str:
    """A line of the table."""
    unit = f" {tunable.unit}" if tunable.unit else ""
    span = (
        f"bits of 0x{int(tunable.most):x}"
        if tunable.mask
        else f"{tunable.least:g} to {tunable.most:g}{unit}"
    )
    default = f"{float(value_of(Settings(), tunable.key)):g}" if tunable.key else "0"
    key = f"`{tunable.key}`" if tunable.key else ""
    ground = " (locked in flight)" if tunable.on_ground else ""
    return (
        f"| `{tunable.name}` | {tunable.type.name} | {span} | {default} | "
        f"{tunable.meaning}{ground} | {key} |"
    )


def test_the_table_is_that_of_the_code() -> None:
    text = PAGE.read_text("utf-8")
    shown = text.partition("|---|---|---|---|---|---|\n")[2].partition("\n\n")[0].splitlines()
    assert shown == [row(tunable) for tunable in (*TUNABLES, RESET)]


def test_every_refusal_and_every_key_on_the_page_exists() -> None:
    text = PAGE.read_text("utf-8")
    for refusal in Refusal:
        assert f"| {refusal} |" in text
    keys = set(re.findall(r"`\[component\] (\w+)", text))
    assert keys == {"parameters", "parameter_encoding", "parameter_hz", "parameter_file"}
    assert keys <= set(ComponentSettings.model_fields)
    assert APPLY_US == 100_000
    assert f"{len(TUNABLES) + 1} parameters" in text
