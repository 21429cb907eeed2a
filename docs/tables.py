"""Fills tables of pages from what was measured and from the program's own definitions.

``python docs/tables.py`` writes between two comments of any page, so that no figure is typed by
hand; ``--check`` only says which pages are out of date. Comments of a table, and its end::

    <!-- measured airspeed0 aoa0 -->        smallest faults of these, in all configurations
    <!-- measured acc_x acc_z of one IMU, attitude of its own -->       in this one alone
    <!-- false alarms of one pitot; two pitots -->    judged hours and bound of configurations
    <!-- settings air.margin_one air.min_shift -->   what each profile has, and what it means
    <!-- reasons -->                                  why a sensor is not judged, and what to do
    <!-- end of the table -->
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Final

DOCS: Final = Path(__file__).parent
sys.path.insert(0, str(DOCS.parent))

SOURCE: Final = DOCS / "detectability.md"
END: Final = "<!-- end of the table -->"
MARK: Final = re.compile(
    r"(?P<head><!-- (?P<what>measured|false alarms|settings|reasons)(?P<asked>[^>]*?) -->\n)"
    r".*?(?=" + END + ")",
    re.DOTALL,
)
COLUMNS: Final = (
    *("step 10 s", "step 30 s", "step 60 s"),
    *("ramp/min 10 s", "ramp/min 30 s", "ramp/min 60 s"),
    *("trials", "wrong first"),
)
PROFILES: Final = ("small-uav", "light-aircraft", "transport")

Row = dict[str, str]


def tables(text: str) -> Iterator[tuple[str, list[Row]]]:
    """Heading and rows of every table of a page."""
    heading, names = "", []
    rows: list[Row] = []
    for line in [*text.splitlines(), ""]:
        if line.startswith("#"):
            heading = line.lstrip("# ").strip()
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if not line.startswith("|"):
            if rows:
                yield heading, rows
            names, rows = [], []
        elif not names:
            names = cells
        elif set(line) - set("|-: "):
            rows.append(dict(zip(names, cells, strict=True)))


def table(heads: list[str], rows: list[list[str]], numbers: int = 0) -> str:
    """Markdown of a table, its last ``numbers`` columns set to the right."""
    ruler = ["---"] * (len(heads) - numbers) + ["---:"] * numbers
    lines = ["| " + " | ".join(row) + " |" for row in [heads, *rows]]
    return "\n".join([lines[0], "|" + "|".join(ruler) + "|", *lines[1:]]) + "\n"


def smallest(asked: str, source: str) -> str:
    """Smallest faults of the sensors asked for, ``SENSOR... [of CONFIGURATION]``."""
    sensors, _, only = asked.partition(" of ")
    found = []
    for heading, rows in tables(source):
        flights, _, configuration = heading.partition(": ")
        for row in rows:
            broken = row.get("broken", "")
            if any(f"`{s}`" in broken for s in sensors.split()) and only in ("", configuration):
                found.append([f"{flights}, {configuration}", broken, *(row[c] for c in COLUMNS)])
    if not found:
        raise LookupError(f"nothing was measured of {asked!r}")
    return table(["flights, configuration", "broken", *COLUMNS], found, len(COLUMNS))


def alarms(asked: str, source: str) -> str:
    """False alarms of ``of CONFIGURATION[; CONFIGURATION...]``."""
    wanted = [name.strip() for name in asked.removeprefix("of ").split(";")]
    heads = ["flights", "configuration", "judged hours", "false alarms", "at most an hour"]
    found = [
        [row[head] for head in heads]
        for heading, rows in tables(source)
        if heading == "False alarms"
        for row in rows
        if row["configuration"] in wanted
    ]
    if not found:
        raise LookupError(f"no false alarms were counted of {asked!r}")
    return table(heads, found, 3)


def settings(asked: str, _: str) -> str:
    """Keys, their values (of small-uav, and where another profile differs), their descriptions."""
    from monitor.settings import Settings, load

    loaded = [load(profile) for profile in PROFILES]
    rows = []
    for key in asked.split():
        *sections, name = key.split(".")
        model: type = Settings
        values = list(loaded)
        for section in sections:
            values = [getattr(value, section) for value in values]
            model = type(values[0])
        field = getattr(model, "model_fields").get(name)  # noqa: B009
        if field is None:
            raise LookupError(f"there is no setting {key}")
        default, *others = [f"{getattr(value, name):g}" for value in values]
        differ = [
            f"{profile} {value}"
            for profile, value in zip(PROFILES[1:], others, strict=True)
            if value != default
        ]
        values_shown = ", ".join([default, *differ])
        rows.append(f"* `{key}` ({values_shown}): {field.description}\n")
    return "".join(rows)


def reasons(_asked: str, _source: str) -> str:
    """Why a sensor is not judged, as the report explains it."""
    from links.vocabulary import Reason
    from monitor.report.remedies import remedy

    command = re.compile(r"mavsentry [^,;]+|--config \S+")
    rows = [
        [str(reason), *(command.sub(r"`\g<0>`", words) for words in remedy(str(reason), ""))]
        for reason in Reason
    ]
    return table(["reason", "what it means", "what to do"], rows)


MADE: Final[Mapping[str, Callable[[str, str], str]]] = {
    "measured": smallest,
    "false alarms": alarms,
    "settings": settings,
    "reasons": reasons,
}


def filled(text: str, source: str) -> str:
    """A page with its tables as they should be now."""

    def put(mark: re.Match[str]) -> str:
        asked = mark["asked"].strip()
        return f"{mark['head']}\n{MADE[mark['what']](asked, source)}\n"

    return MARK.sub(put, text)


def main() -> int:
    """Write the tables; with ``--check`` nothing, and 1 where one is out of date."""
    source = SOURCE.read_text(encoding="utf-8")
    stale = []
    for page in sorted(DOCS.rglob("*.md")):
        if "_build" in page.parts:
            continue
        text = page.read_text(encoding="utf-8")
        new = filled(text, source)
        if new != text:
            stale.append(str(page.relative_to(DOCS)))
            if "--check" not in sys.argv:
                page.write_text(new, encoding="utf-8")
    print("\n".join(stale) or "all tables are up to date")
    return 1 if stale and "--check" in sys.argv else 0


if __name__ == "__main__":
    sys.exit(main())
