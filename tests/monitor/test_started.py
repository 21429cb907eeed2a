"""A log's start is a date, or nothing: damaged stamps are no dates."""

from __future__ import annotations

from datetime import UTC, datetime

import pytest

from monitor.started import started


def test_a_start_is_utc() -> None:
    assert started({"start_unix_us": 1_700_000_000_500_000}) == datetime(
        2023, 11, 14, 22, 13, 20, 500_000, UTC
    )


@pytest.mark.parametrize("stamp", [None, 0, -5, 1_000_000, 1_226_000_000_000_000_000, (1 << 63)])
def test_what_no_calendar_has_is_no_start(stamp: int | None) -> None:
    assert started({"start_unix_us": stamp}) is None
    assert started({}) is None
