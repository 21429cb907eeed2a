"""The whole pipeline, compiled and as plain numpy, says the same.

Every kernel of the watches runs without numba (``NUMBA_DISABLE_JIT``), in a process of its own:
what the compiler did to the stream loops, votes and judges cannot have changed a verdict. Both get
the same rows, which compiled links decoded.
"""

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from links.mavlink import Decoder
from links.samples import Batch, Rows
from monitor.pipeline import Pipeline
from monitor.recording import Recording
from monitor.settings import load
from sim_feeds import player, scenario

FLIGHTS = [("demo", "transport", 100.0), ("small-uav-pitot-blockage", "small-uav", 175.0)]


def decoded(name: str, until_s: float) -> dict[str, Rows]:
    """Rows of the beginning of a bundled scenario."""
    decoder = Decoder()
    frames = player.frames_of(scenario.load(name).fly())
    batch = Batch.concatenate([decoder.feed(b"".join(f for _, f in frames)), decoder.finish()])
    return {s: r[r["t_us"] < until_s * 1e6] for s, r in batch.rows.items()}


def judge(rows: Mapping[str, Rows], profile: str) -> Recording:
    """What the pipeline says of them."""
    pipeline, recording = Pipeline(load(profile)), Recording()
    recording.add(pipeline.feed(Batch(rows)))
    recording.add(pipeline.finish())
    return recording


def changes(recording: Recording) -> list[tuple[int, str, str, str]]:
    return [(v.t_us, v.sensor, str(v.state), str(v.kind)) for v in recording.verdicts]


@pytest.mark.parametrize(("name", "profile", "until_s"), FLIGHTS)
def test_compiled_and_interpreted_pipelines_agree(
    name: str, profile: str, until_s: float, tmp_path: Path
) -> None:
    rows = decoded(name, until_s)
    given, file = tmp_path / "rows.npz", tmp_path / "interpreted.npz"
    np.savez(given, **rows)
    subprocess.run(
        [sys.executable, __file__, profile, str(given), str(file)],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        cwd=Path(__file__).parents[2],
        check=True,
        timeout=300,
    )
    compiled, interpreted = judge(rows, profile), np.load(file)
    said = changes(compiled)
    assert any(state == "faulty" for _, _, state, _ in said)
    assert [tuple(row) for row in interpreted["changes"]] == [tuple(map(str, c)) for c in said]
    for estimate, rows in compiled.estimates.items():
        for field in rows.dtype.names or ():
            np.testing.assert_allclose(
                interpreted[estimate][field], rows[field], rtol=1e-6, atol=1e-9, err_msg=field
            )


if __name__ == "__main__":
    profile_name, rows_file, out = sys.argv[1:]
    result = judge(dict(np.load(rows_file)), profile_name)
    np.savez(out, changes=np.array(changes(result)), **result.estimates)
