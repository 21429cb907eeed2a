"""The bench case of the engine's filter: the peers do the same work, and it is worth compiling."""

from monitor.commands.bench import NAMES
from monitor.commands.bench_cases import engine
from monitor.commands.timing import interleaved


def test_peers_compute_the_same_and_take_longer():
    (case,) = engine.cases()
    assert case.name in NAMES["engine"]
    assert set(case.peers) == {"python_loop", "numpy_batched"}
    assert case.value() < 1e-9
    timings = interleaved({"": case.run, **case.peers}, 0.5, rounds_min=2)
    ours = timings.pop("").median_us / case.calls
    for peer, timing in timings.items():
        assert timing.median_us / case.peer_calls[peer] > 10.0 * ours
