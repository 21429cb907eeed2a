"""Fills docs/api.md with the public names, their signatures and promises, from the code itself.

``python docs/api_names.py`` writes between two comments of the page. A test says when the page is
out of date, so that no signature changes unseen, and that nothing in it lacks a description.
"""

from __future__ import annotations

import enum
import inspect
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any, Final

PAGE: Final = Path(__file__).parent / "api.md"
sys.path.insert(0, str(PAGE.parents[1]))

GROUPS: Final[Mapping[str, tuple[str, ...]]] = {
    "Watching a vehicle": ("Monitor", "ArraySource", "warm_up"),
    "What is said": ("StepResult", "Verdict", "State", "Reason", "Kind", "Rejection"),
    "Logs": (
        *("analyze_log", "Analysis", "Estimates", "EstimateSink"),
        *("open_log", "LogReader", "LogInfo", "LogError"),
    ),
    "Settings, version": ("load_settings", "Settings", "SettingsError", "PROFILES", "__version__"),
    "Samples": ("Batch", "Rows", "QUANTITIES", "DecoderOptions", "Vehicle"),
}
PLAIN: Final = {
    "PROFILES": "Names of the bundled airframe classes; the first is the default.",
    "QUANTITIES": "Quantity (`imu`, `gps` ...) to the numpy dtype of its samples, with the unit in "
    "the name of every field.",
    "Rows": 'A numpy structured array of samples or estimates: `rows["t_us"]`.',
    "__version__": "The installed version, as `mavsentry --version` says it.",
}
"""What is no class and no function, and so cannot carry a description of its own."""

OUR_OWN: Final = frozenset({"LogInfo.note_rows", "DecoderOptions.ranked"})
"""Methods of public classes that only our own readers call: not public."""

FIELDS: Final[Mapping[str, Mapping[str, str]]] = {
    "Vehicle": {
        "system_id": "MAVLink system id.",
        "autopilot": "MAV_AUTOPILOT number.",
        "type": "MAV_TYPE number.",
    }
}
"""Fields of classes whose description is one sentence."""

MORE: Final = {
    "DecoderOptions": "Those of settings: `settings.links.decoder_options()`.",
    "Settings": "Its tables and keys: [configuration](configuration.md).",
}
"""What stands in place of a class's fields."""

ONE_SENTENCE: Final = 3
"""Lines of a name of which there is no more to say than a sentence."""

MARK: Final = re.compile(r"(?<=<!-- names -->\n).*?(?=<!-- end of the names -->)", re.DOTALL)


def sections(thing: object) -> dict[str, list[str]]:
    """Numpy-style docstring: heading -> lines; what stands before the first has none."""
    out: dict[str, list[str]] = {"": []}
    at = ""
    lines = (inspect.getdoc(thing) or "").splitlines()
    for line, below in zip(lines, [*lines, ""][1:], strict=True):
        if line and below and set(below) == {"-"} and len(below) == len(line):
            at = line
            out[at] = []
        elif not (line and set(line) == {"-"}):
            out[at].append(line)
    return out


def entries(lines: list[str]) -> dict[str, str]:
    """Name -> text of a section that lists names; several may share a text."""
    out: dict[str, str] = {}
    names: list[str] = []
    for line in lines:
        if line and not line.startswith(" "):
            names = [name.strip() for name in line.partition(" : ")[0].split(",")]
            out |= dict.fromkeys(names, "")
        elif line.strip():
            out |= {name: f"{out[name]} {line.strip()}".strip() for name in names}
    return out


def promise(thing: object) -> str:
    """First paragraph of a description, as Markdown."""
    return markdown(" ".join(sections(thing)[""]).partition("  ")[0])


def markdown(text: str) -> str:
    """Text of a description, as Markdown."""
    text = re.sub(r":\w+:`~?(?:[\w.]+\.)?(\w+)`", r"`\1`", text)
    return text.replace("``", "`").strip()


def members(thing: type) -> Iterator[tuple[str, object]]:
    """Public methods and properties that a class of ours defines itself."""
    for name, member in vars(thing).items():
        if f"{thing.__name__}.{name}" in OUR_OWN:
            continue
        plain = member.__func__ if isinstance(member, staticmethod | classmethod) else member
        if not name.startswith("_") and (inspect.isfunction(plain) or isinstance(plain, property)):
            yield name, plain


def is_model(thing: object) -> bool:
    """Whether it is a table of settings, whose keys have a page of their own."""
    return hasattr(thing, "model_fields")


def own_init(thing: type) -> bool:
    """Whether a class is made by calling it with arguments of its own."""
    if "__init__" not in vars(thing) or is_model(thing) or is_protocol(thing):
        return False
    return bool(inspect.signature(thing).parameters)


def is_protocol(thing: object) -> bool:
    """Whether a class only says what others must have."""
    return bool(getattr(thing, "_is_protocol", False))


def signature(thing: Any, name: str) -> str:
    """Signature as the source has it."""
    found = inspect.signature(thing)
    parameters = [p for p in found.parameters.values() if p.name != "self"]
    text = f"{name}{found.replace(parameters=parameters)}".replace("'", "")
    text = re.sub(r"\b(?:\w+\.)+(?=[A-Z])", "", text)
    return re.sub(r"<function [^>]*>+( at \w+>)?", "...", text).removesuffix(" -> None")


def fields(thing: type) -> dict[str, str]:
    """Attributes that a class's description lists."""
    return dict(FIELDS.get(thing.__name__, entries(sections(thing).get("Attributes", []))))


def undescribed(name: str, thing: Any) -> list[str]:
    """What of a public name has no description: itself, members, fields, parameters."""
    if name in PLAIN:
        return []
    missing = [] if promise(thing) else [name]
    if not inspect.isclass(thing):
        return missing + [f"{name}({p})" for p in _unsaid(thing)]
    if issubclass(thing, enum.Enum) or is_model(thing):
        return missing
    for member, plain in members(thing):
        missing += [] if promise(plain) else [f"{name}.{member}"]
        if inspect.isfunction(plain):
            missing += [f"{name}.{member}({p})" for p in _unsaid(plain)]
    if is_dataclass(thing):
        said = fields(thing)
        missing += [f"{name}.{f}" for f in thing.__dataclass_fields__ if f not in said]
    elif own_init(thing):
        said = entries(sections(thing).get("Parameters", []))
        given = [p for p in inspect.signature(thing).parameters if p != "self"]
        missing += [f"{name}({p})" for p in given if p not in said]
    return missing


def _unsaid(function: Any) -> list[str]:
    """Parameters that nothing is said of; of a single one the first sentence speaks."""
    given = [p for p in inspect.signature(function).parameters if p != "self"]
    said = entries(sections(function).get("Parameters", []))
    return [] if len(given) == 1 else [p for p in given if p not in said]


def countable(name: str, thing: Any) -> int:
    """How many descriptions a public name should have, its members' and parameters' included."""
    if name in PLAIN or not inspect.isclass(thing):
        return 1 + (0 if name in PLAIN else len(inspect.signature(thing).parameters))
    if issubclass(thing, enum.Enum) or is_model(thing):
        return 1
    count = 1
    for _, plain in members(thing):
        count += 1
        count += len(inspect.signature(plain).parameters) - 1 if inspect.isfunction(plain) else 0
    if is_dataclass(thing):
        count += len(thing.__dataclass_fields__)
    elif own_init(thing):
        count += len(inspect.signature(thing).parameters)
    return count


def shown(name: str, thing: Any) -> str:
    """One public name as the page shows it."""
    if name in PLAIN:
        return f"#### `{name}`\n\n{PLAIN[name]}\n"
    text = f"#### `{name}`\n\n"
    if not inspect.isclass(thing) or (own_init(thing) and not is_dataclass(thing)):
        text += f"```text\n{signature(thing, name)}\n```\n\n"
    text += promise(thing) + "\n"
    if not inspect.isclass(thing):
        return text
    if issubclass(thing, enum.Enum):
        words = ", ".join(f"`{member.name}` *{member.value}*" for member in thing)
        return f"{text}\nMembers, which compare and print as these words: {words}.\n"
    if name in MORE:
        return f"{text}\n{MORE[name]}\n"
    together: dict[str, list[str]] = {}
    for field, said in fields(thing).items():
        together.setdefault(markdown(said), []).append(f"`{field}`")
    lines = [f"* {', '.join(named)}: {said}\n" for said, named in together.items()]
    for member, plain in members(thing):
        if isinstance(plain, property):
            returned = str(inspect.signature(plain.fget).return_annotation)  # type: ignore[arg-type]
            lines.append(f"* `{member}: {returned}`: {promise(plain)}\n")
        else:
            lines.append(f"* `{signature(plain, member)}`: {promise(plain)}\n")
    return text + ("\n" + "".join(lines) if lines else "")


def filled(page: str) -> str:
    """The page with its names as they are now."""
    import monitor

    parts = []
    for heading, names in GROUPS.items():
        parts.append(f"### {heading}\n")
        blocks = [shown(name, getattr(monitor, name)) for name in names]
        short = [block for block in blocks if block.count("\n") == ONE_SENTENCE]
        parts += [block for block in blocks if block not in short]
        if short:
            parts.append("".join("* " + block[5:].replace("\n\n", ": ", 1) for block in short))
    return MARK.sub(lambda _: "\n" + "\n".join(parts) + "\n", page)


if __name__ == "__main__":
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
