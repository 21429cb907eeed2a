"""How long a report takes to open: ``python -m tests.browser.opening REPORT.html [TIMES]``.

The page itself marks when the charts in sight are drawn, and when all are; times count from the
beginning of its loading. Each opening has a fresh context; the browser is headless.
"""

from __future__ import annotations

import statistics
import sys
import time
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

from tests.browser.visits import DESK, find_chromium, flags

MARKS = ("charts in sight", "all charts")
LONGEST_S = 60.0
_SEEN = "performance.getEntriesByType('mark').map(mark => [mark.name, mark.startTime])"


def opened(page: Page, report: Path) -> dict[str, float]:
    """Mark -> milliseconds from the beginning of loading.

    Raises
    ------
    TimeoutError
        Not all charts were drawn in :data:`LONGEST_S`.
    """
    page.goto(report.resolve().as_uri())
    end_s = time.monotonic() + LONGEST_S
    while time.monotonic() < end_s:
        marks = dict(page.evaluate(_SEEN))
        if set(MARKS) <= set(marks):
            return marks
        page.wait_for_timeout(50)
    raise TimeoutError(f"{report}: not all charts drawn in {LONGEST_S:g} s")


def main(report: Path, times: int) -> None:
    """Open it so often and print the least, the median and the largest of each mark."""
    taken: dict[str, list[float]] = {name: [] for name in MARKS}
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=find_chromium(), args=flags())
        for _ in range(times):
            context = browser.new_context(viewport=DESK)
            marks = opened(context.new_page(), report)
            for name, values in taken.items():
                values.append(marks[name])
            context.close()
        print(f"Chromium {browser.version}, {report.stat().st_size / 1e6:.2f} MB")
        browser.close()
    for name, values in taken.items():
        least, middle, most = min(values), statistics.median(values), max(values)
        print(f"{name}: {least:.0f} to {most:.0f} ms, median {middle:.0f}")


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 8)
