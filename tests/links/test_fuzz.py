"""A short run of the fuzz command, and the same mutations drawn and shrunk by hypothesis."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from links.samples import Batch, empty_rows

from . import fuzz
from .mutations import KINDS, Mutation, mutated

MUTATIONS = st.lists(
    st.builds(
        Mutation,
        st.sampled_from(KINDS),
        st.floats(0.0, 1.0, exclude_max=True),
        st.integers(1, 6000),
        st.integers(0, (1 << 32) - 1),
    ),
    min_size=1,
    max_size=8,
)


@pytest.mark.parametrize("reader", fuzz.READERS)
def test_a_megabyte_of_damaged_logs_knocks_nothing_over(reader: str, tmp_path: Path) -> None:
    tally = fuzz.run(reader, 1_000_000, 6, tmp_path)
    assert tally.bytes >= 1_000_000
    assert tally.rows > 1000  # not refused as a whole: damage costs what it touched
    assert tally.refused < tally.inputs // 2
    assert tally.analyzed > 0
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("reader", fuzz.READERS)
@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(MUTATIONS)
def test_no_damage_is_an_exception(reader: str, tmp_path: Path, mutations: list[Mutation]) -> None:
    file = tmp_path / "x"
    file.write_bytes(mutated(fuzz.sounds(reader)[0][0], mutations))
    fuzz.examine(reader, file, analyzed=False, tally=fuzz.Tally())


@pytest.mark.parametrize("reader", fuzz.READERS)
def test_an_input_is_drawn_again_by_its_number(reader: str) -> None:
    third = [x for x, _ in zip(fuzz.inputs(reader, 4), range(4), strict=False)][3]
    (alone,) = fuzz.inputs(reader, 4, only=3)
    assert mutated(*alone[1:]) == mutated(*third[1:])
    assert mutated(*alone[1:]) != alone[1].data


def test_what_fails_is_kept_with_the_command_that_repeats_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def breaks(*_: object, **__: object) -> None:
        raise IndexError

    monkeypatch.setattr(fuzz, "examine", breaks)
    with pytest.raises(IndexError):
        fuzz.run("bin", 1000, 9, tmp_path)
    assert (tmp_path / "failed-9.BIN").stat().st_size > 0
    told = (tmp_path / "failed-bin-9.txt").read_text()
    assert "python -m tests.links.fuzz bin --seed 9 --only 0" in told


def test_a_row_out_of_its_time_is_a_failure() -> None:
    rows = empty_rows("imu0", 3)
    rows["seq"], rows["t_us"] = [0, 1, 2], [0, 9_000_000, 1_000_000]
    with pytest.raises(AssertionError, match="too late"):
        fuzz.check(Batch({"imu0": rows}))
    rows["seq"] = [0, 1, 3]
    with pytest.raises(AssertionError, match="numbers"):
        fuzz.check(Batch({"imu0": rows}))
