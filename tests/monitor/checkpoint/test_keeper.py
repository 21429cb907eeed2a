"""Who takes a checkpoint up, who does not and what he says; and how it is kept."""

import threading
import time
from dataclasses import replace

import pytest

from links.mavlink.encoder import Encoder
from links.vocabulary import State
from monitor.checkpoint import Checkpointer, file, identity, keeper, snapshot
from monitor.checkpoint.identity import Moment, age_s
from monitor.settings import Settings, load

from .conftest import monitor

FLOWN = 1200
"""Slices of the flight up to the checkpoint: a minute, in which a pitot has failed."""


@pytest.fixture(scope="module")
def kept(pair, tmp_path_factory):
    """A folder with the checkpoint of a monitor, and that monitor."""
    folder = tmp_path_factory.mktemp("state")
    stages = monitor()
    for part in pair[:FLOWN]:
        stages.publisher.note(stages.pipeline.feed(stages.decoder.feed(part)))
    stages.publisher.due(1, stages.pipeline.now_us, silent=False)
    Checkpointer(folder, load(), *stages).close()
    assert [p.name for p in folder.iterdir()] == ["checkpoint-1-191"]
    return folder, stages


def words(t_us, system=1, kind=1):
    """The first that is heard of a vehicle."""
    say = Encoder(system, 1, "ardupilotmega").encode
    beat = say("HEARTBEAT", type=kind, autopilot=3, system_status=4, mavlink_version=3)
    return beat + say("ATTITUDE", time_boot_ms=t_us // 1000)


def started(folder, data, settings=None):
    """A monitor that finds this folder and hears these bytes first; whether it goes on, and why."""
    settings = settings or load()
    said = []
    stages = monitor(settings)
    checkpointer = Checkpointer(folder, settings, *stages, said.append)
    checkpointer.resume()
    stages.pipeline.feed(stages.decoder.feed(data))
    assert bool(stages.publisher.states) == checkpointer.resumed
    return checkpointer.resumed, "; ".join(said), stages


def newest_us(stages):
    return stages.decoder.clock.newest_us


def test_what_was_learnt_comes_back_and_says_so(kept):
    folder, stages = kept
    taken, said, again = started(folder, words(newest_us(stages) + 2_500_000))
    assert taken
    assert said == "taken up from 2.5 s ago; faulty: airspeed0, imu0.acc_x"
    assert again.publisher.states == stages.publisher.states
    assert again.pipeline.flying


@pytest.mark.parametrize(
    ("later_s", "why"),
    [
        (119.9, ""),
        (-4.0, ""),  # messages that were late
        (120.1, "it is 120 s old, 120 s are allowed"),
        (-6.0, "the vehicle has booted since"),
    ],
)
def test_the_vehicles_clock_says_how_old_it_is(kept, later_s, why):
    folder, stages = kept
    taken, said, _ = started(folder, words(newest_us(stages) + round(later_s * 1e6)))
    assert (taken, why in said) == (not why, True)


def test_a_vehicle_that_has_booted_is_learnt_anew(kept, pair):
    folder, _ = kept
    taken, _, again = started(folder, b"".join(pair[:200]))
    fresh = monitor()
    fresh.pipeline.feed(fresh.decoder.feed(b"".join(pair[:200])))
    assert not taken
    assert repr(again.pipeline.states()) == repr(fresh.pipeline.states())
    assert again.pipeline.now_us == fresh.pipeline.now_us


@pytest.mark.parametrize("other", [{"kind": 2}, {"system": 7}])
def test_another_vehicle_gets_nothing_of_it(kept, other):
    folder, stages = kept
    taken, said, _ = started(folder, words(newest_us(stages) + 10**6, **other))
    assert not taken
    assert said == "checkpoint not used: it is of another vehicle"


def hosts(monkeypatch, **changes):
    """Shift the host's clocks as a checkpoint finds them."""
    now = Moment.now()
    monkeypatch.setattr(identity.Moment, "now", staticmethod(lambda: replace(now, **changes)))


@pytest.mark.parametrize(
    ("boot", "boot_s", "wall_s", "age"),
    [
        ("same", 30, 5_000, 30.0),  # its wall clock was set meanwhile
        ("other", -900, 40, 40.0),
        ("other", -900, -40, None),  # no battery for the clock: it goes on from where it was
        ("", 30, 10**9, 1e9),
    ],
)
def test_the_hosts_clocks_count_as_far_as_they_can_be_believed(boot, boot_s, wall_s, age):
    then = Moment("same" if boot else "", 1_000_000_000, 1_700_000_000_000_000)
    now = Moment(boot, then.since_boot_us + boot_s * 10**6, then.unix_us + wall_s * 10**6)
    assert age_s(then, now) == age


def test_the_computer_booted_and_its_wall_clock_is_behind(kept, monkeypatch):
    folder, stages = kept
    hosts(monkeypatch, boot="another", unix_us=10**15)
    assert started(folder, words(newest_us(stages) + 40_000_000))[0]


def test_an_old_file_is_refused_whatever_the_vehicle_says(kept, monkeypatch):
    folder, stages = kept
    hosts(monkeypatch, boot="another", unix_us=Moment.now().unix_us + 86_400 * 10**6)
    taken, said, _ = started(folder, words(newest_us(stages) + 1_000_000))
    assert not taken
    assert "it is 24 h old" in said


def test_other_code_starts_anew(kept, monkeypatch):
    folder, stages = kept
    monkeypatch.setattr(snapshot, "code_digest", lambda: "of another version")
    taken, said, _ = started(folder, words(newest_us(stages) + 10**6))
    assert not taken
    assert "another version" in said


def with_keys(section, **keys):
    """Our settings, but for these."""
    mine = load()
    changed = getattr(mine, section).model_dump() | keys
    return Settings.model_validate(mine.model_dump() | {section: changed})


def test_a_threshold_that_can_be_retuned_is(kept):
    folder, stages = kept
    settings = with_keys("imu", difference_sigma=9.0)
    taken, _, again = started(folder, words(newest_us(stages) + 10**6), settings)
    assert taken
    assert again.pipeline.settings == settings
    assert not again.pipeline.retune(settings).taken


def test_a_key_that_the_state_was_made_with_is_named(kept):
    folder, stages = kept
    settings = with_keys("imu", window_s=(0.4, 1.0, 3.0))
    taken, said, _ = started(folder, words(newest_us(stages) + 10**6), settings)
    assert not taken
    assert "other settings: imu.window_s" in said


def test_a_stream_that_is_read_in_another_way_is_named(kept):
    folder, stages = kept
    settings = with_keys("links", airspeed_ratio=1.7)
    taken, said, _ = started(folder, words(newest_us(stages) + 10**6), settings)
    assert not taken
    assert "links: airspeed_ratio" in said


def test_what_is_damaged_is_said_and_costs_nothing_else(kept, tmp_path):
    _, stages = kept
    (tmp_path / "checkpoint-1-191").write_bytes(b"mavsentry checkpoint 1\n")
    (tmp_path / "checkpoint-1-191").chmod(0o600)
    taken, said, _ = started(tmp_path, words(newest_us(stages) + 10**6))
    assert (taken, said) == (False, "checkpoint not used: it is damaged")


def test_nothing_is_kept_without_a_folder(pair, tmp_path, written):
    stages = monitor()
    checkpointer = Checkpointer(None, load(), *stages)
    checkpointer.resume()
    for k, part in enumerate(pair[:300]):
        stages.pipeline.feed(stages.decoder.feed(part))
        checkpointer.turn(k * 50_000)
    checkpointer.close()
    assert not written


def test_nothing_is_kept_before_a_vehicle_is_heard(tmp_path):
    Checkpointer(tmp_path / "state", load(), *monitor()).close()
    assert not (tmp_path / "state").exists()


@pytest.fixture
def written(monkeypatch):
    """Files that would have been written, by the thread that writes."""
    files = []
    monkeypatch.setattr(keeper.file, "replace", lambda path, data: files.append((path, data)))
    return files


def flying(data, folder, said=None):
    stages = monitor()
    checkpointer = Checkpointer(folder, load(), *stages, (said if said is not None else []).append)

    def turn(now_s):
        if data:
            stages.pipeline.feed(stages.decoder.feed(data.pop(0)))
        checkpointer.turn(round(now_s * 1e6))

    return checkpointer, turn


def settled(checkpointer):
    """The writer has written what it was offered."""
    checkpointer._writer.close(5.0)


def test_it_is_kept_every_few_seconds_of_flight_and_not_of_silence(pair, tmp_path, written):
    checkpointer, turn = flying(pair[:240], tmp_path)
    for k in range(480):
        turn(k * 0.05)
        time.sleep(0.002 if k % 100 == 0 else 0.0)
    settled(checkpointer)
    assert len(written) == 3  # at 5, 10 and 15 s; from 12 s on nothing came
    assert threading.active_count() < 10


def test_a_full_disk_is_said_once_and_again_only_after_it_was_well(pair, tmp_path, monkeypatch):
    full = True
    tried = threading.Event()

    def replace(path, data):
        tried.set()
        if full:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(keeper.file, "replace", replace)
    said = []
    checkpointer, turn = flying(list(pair[:700]), tmp_path, said)
    for k in range(700):
        tried.clear()
        turn(k * 0.05)
        if k and k % 100 == 0:
            assert tried.wait(5.0)
            time.sleep(0.01)
        full = not 300 < k < 450
    settled(checkpointer)
    assert said == ["checkpoint cannot be kept: No space left on device"] * 2


def test_a_disk_that_hangs_holds_up_nothing(pair, tmp_path, monkeypatch):
    release = threading.Event()
    monkeypatch.setattr(keeper.file, "replace", lambda path, data: release.wait(10.0))
    checkpointer, turn = flying(list(pair[:400]), tmp_path)
    began_s = time.monotonic()
    for k in range(400):
        turn(k * 0.05)
    checkpointer._writer.close(0.1)
    assert time.monotonic() - began_s < 5.0
    release.set()


def test_what_is_no_data_ends_the_keeping_and_is_named(pair, tmp_path):
    said = []
    checkpointer, turn = flying(list(pair[:250]), tmp_path, said)
    checkpointer._stages[1]._judged["x"] = print
    for k in range(250):
        turn(k * 0.05)
    assert said == [
        "no checkpoints are kept: _State: Pipeline: builtins.builtin_function_or_method is no data"
    ]
    assert not list(tmp_path.iterdir())


def test_a_file_is_small(kept):
    folder, _ = kept
    size = (folder / "checkpoint-1-191").stat().st_size
    assert size < 1_500_000
    assert file.unpack((folder / "checkpoint-1-191").read_bytes())[0]["rows"] > 1000


def test_states_that_were_faulty_are_told_by_the_first_mask(kept):
    folder, stages = kept
    _, _, again = started(folder, words(newest_us(stages) + 3_000_000))
    sent = again.publisher.due(10**9, newest_us(stages) + 3_000_000, silent=False)
    masks = {m.fields["name"]: m.fields["value"] for m in sent if m.name == "NAMED_VALUE_FLOAT"}
    assert again.publisher.states["airspeed0"] is State.FAULTY
    assert masks["FLT_AIR"] == 1.0
    assert masks["FLT_IMU0"] == 1.0
    assert not [m.fields["text"] for m in sent if m.name == "STATUSTEXT"]
