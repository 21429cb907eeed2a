"""docs/fleet.md: its table of columns is the dataset's, and its queries run."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from monitor.fleet.dataset import save
from monitor.fleet.places import Place
from monitor.fleet.tables import SCHEMAS
from tests.monitor.fleet.small_fleet import dataset, fault, flight, lost

DOCS = Path(__file__).parents[3] / "docs" / "fleet.md"
QUERIES = re.findall(r"```sql\n(.*?);\n```", DOCS.read_text("utf-8"), re.DOTALL)


def test_every_column_is_documented_in_its_table() -> None:
    documented: dict[str, list[str]] = {}
    table = ""
    for name, column in re.findall(r"^\| (`\w+`)? ?\| `(\w+)` \|", DOCS.read_text("utf-8"), re.M):
        table = name.strip("`") or table
        documented.setdefault(table, []).append(column)
    assert documented == {name: list(schema.names) for name, schema in SCHEMAS.items()}


@pytest.mark.parametrize("query", QUERIES)
def test_every_query_is_one_line_that_finds_something(
    query: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    duckdb = pytest.importorskip("duckdb")
    place = Place(str(tmp_path / "fleet"))
    tables = dataset(
        flight("/l/plane-a/0.tlog", [fault(cleared_s=610.0)], month=2),
        flight("/l/plane-b/0.tlog", month=5),
        lost("/l/plane-b/1.tlog", "the log is empty"),
    )
    save(place, tables)
    monkeypatch.chdir(tmp_path)
    assert "\n" not in query
    assert duckdb.sql(query).fetchall()


def test_there_are_queries() -> None:
    assert len(QUERIES) >= 5
