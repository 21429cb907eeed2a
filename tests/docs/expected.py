"""What a page says a command prints, held against what it printed."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import cache

ANY_LINES = ("...", "…")

_NUMBER = re.compile(r"(?<![A-Za-z0-9_.])[+\-−]?\d+(?:\.\d+)?")
_ANY_HOST = re.compile(r"\b0\.0\.0\.0\b")
_LEAST = 1e-9


def lines_of(text: str) -> list[str]:
    """Lines without what does not count: spaces, and how long the rules of a table are."""
    plain = _ANY_HOST.sub("127.0.0.1", text).replace("\r", "\n")
    plain = re.sub(r"([─━═])\1*", r"\1", plain)
    lines = (" ".join(line.split()) for line in plain.splitlines())
    return [line for line in lines if line]


def agrees(expected: str, actual: str, numbers: str = "", *, so_far: bool = False) -> bool:
    """Whether ``actual`` is what the page shows.

    Parameters
    ----------
    expected
        With ``...`` as a line for any lines and within a line for anything.
    numbers
        How far numbers may differ: empty, ``10 %`` or ``any``.
    so_far
        More may still follow.
    """
    return _follow(_patterns(expected, numbers), lines_of(actual), so_far)


_Line = Callable[[str], bool]


def _patterns(expected: str, numbers: str) -> list[_Line | None]:
    return [None if line in ANY_LINES else _line(line, numbers) for line in lines_of(expected)]


def _line(expected: str, numbers: str) -> _Line:
    """Whether one line is the expected one."""
    tolerance = _tolerance(numbers)
    pieces, wanted, last = [], [], 0
    for found in _NUMBER.finditer(expected) if numbers else ():
        pieces += [_literal(expected[last : found.start()]), f"({_NUMBER.pattern})"]
        wanted.append(found[0])
        last = found.end()
    pattern = re.compile("".join([*pieces, _literal(expected[last:])]))

    def same(line: str) -> bool:
        match = pattern.fullmatch(line)
        return match is not None and all(
            _near(a, b, tolerance) for a, b in zip(wanted, match.groups(), strict=True)
        )

    return same


def _literal(text: str) -> str:
    return ".*?".join(re.escape(piece) for piece in re.split(r"\.\.\.|…", text))


def _tolerance(numbers: str) -> float:
    if numbers in ("", "any"):
        return float("inf")
    share = re.fullmatch(r"(\d+(?:\.\d+)?) ?%", numbers)
    if share is None:
        raise ValueError(f"numbers: {numbers}: neither like 10 % nor any")
    return float(share[1]) / 100.0


def _near(wanted: str, found: str, tolerance: float) -> bool:
    """Within the tolerance, or one in the last digit that is shown."""
    a, b = (float(text.replace("−", "-")) for text in (wanted, found))
    digit = 10.0 ** -len(wanted.partition(".")[2])
    return abs(a - b) <= max(tolerance * abs(a), digit) + _LEAST


def _follow(patterns: Sequence[_Line | None], lines: Sequence[str], so_far: bool) -> bool:
    @cache
    def fits(at: int, line: int) -> bool:
        if at == len(patterns):
            return so_far or line == len(lines)
        pattern = patterns[at]
        if pattern is None:
            return any(fits(at + 1, later) for later in range(line, len(lines) + 1))
        return line < len(lines) and pattern(lines[line]) and fits(at + 1, line + 1)

    return fits(0, 0)
