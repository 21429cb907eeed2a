"""The file: whole or not there, its owner's alone."""

import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest

from monitor.checkpoint import file
from monitor.checkpoint.file import Unusable, pack, read, replace, unpack
from monitor.checkpoint.graph import flatten

FLAT = flatten({"x": np.arange(1000.0), "said": ["imu0"]})
DATA = pack({"rows": 3}, FLAT)


def test_what_was_packed_comes_back():
    about, flat = unpack(DATA)
    assert about == {"rows": 3}
    assert flat.tree == FLAT.tree
    assert flat.arrays == FLAT.arrays


@pytest.mark.parametrize("length", [0, 5, 23, 31, 64, len(DATA) // 2, len(DATA) - 1])
def test_a_part_of_a_file_is_refused(length):
    with pytest.raises(Unusable):
        unpack(DATA[:length])


def test_any_bit_that_is_wrong_is_noticed():
    for at in range(0, len(DATA), 37):
        spoilt = bytearray(DATA)
        spoilt[at] ^= 0x10
        with pytest.raises(Unusable):
            unpack(bytes(spoilt))


def test_a_file_that_unfolds_without_end_is_refused(monkeypatch):
    monkeypatch.setattr(file, "BYTES_MAX", 4000)
    with pytest.raises(Unusable, match="damaged"):
        unpack(DATA)


def test_it_is_its_owners_alone(tmp_path):
    path = tmp_path / "state" / "checkpoint"
    replace(path, DATA)
    assert path.stat().st_mode & 0o777 == 0o600
    assert path.parent.stat().st_mode & 0o777 == 0o700
    assert read(path) == DATA
    assert [p.name for p in path.parent.iterdir()] == ["checkpoint"]


@pytest.mark.parametrize("mode", [0o620, 0o602])
def test_one_that_others_can_write_to_is_refused(tmp_path, mode):
    path = tmp_path / "checkpoint"
    replace(path, DATA)
    path.chmod(mode)
    with pytest.raises(Unusable, match="others"):
        read(path)


def test_no_link_is_followed(tmp_path):
    replace(tmp_path / "there", DATA)
    (tmp_path / "checkpoint").symlink_to(tmp_path / "there")
    with pytest.raises(Unusable):
        read(tmp_path / "checkpoint")
    (tmp_path / ".other.new").symlink_to(tmp_path / "there")
    with pytest.raises(OSError):
        replace(tmp_path / "other", b"")
    assert (tmp_path / "there").read_bytes() == DATA


def test_a_full_disk_leaves_what_was_there(tmp_path, monkeypatch):
    path = tmp_path / "checkpoint"
    replace(path, DATA)

    def full(fd):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(file.os, "fsync", full)
    with pytest.raises(OSError):
        replace(path, b"new")
    assert path.read_bytes() == DATA
    assert [p.name for p in tmp_path.iterdir()] == ["checkpoint"]


WRITES = """
    import os, sys, time
    from pathlib import Path
    from monitor.checkpoint.file import pack, replace
    from monitor.checkpoint.graph import flatten
    import numpy as np

    def slow(fd, fsync=os.fsync):  # as on a card of a companion computer
        time.sleep(0.02)
        fsync(fd)

    os.fsync, n = slow, 0
    while True:
        n += 1
        replace(Path(sys.argv[1]), pack({"n": n}, flatten(np.full(20_000, n / 7))))
        if n == 1:
            print("begun", flush=True)
"""


def test_killed_while_it_writes_it_leaves_a_whole_file(tmp_path):
    path = tmp_path / "checkpoint"
    in_the_middle = 0
    for k in range(5):
        writer = subprocess.Popen(
            [sys.executable, "-c", textwrap.dedent(WRITES), str(path)],
            stdout=subprocess.PIPE,
            cwd=Path(__file__).parents[3],
        )
        assert writer.stdout is not None
        writer.stdout.readline()
        time.sleep(0.1 + 0.007 * k)
        writer.send_signal(signal.SIGKILL)
        writer.wait()
        writer.stdout.close()
        about, flat = unpack(read(path))
        assert flat.arrays == [np.full(20_000, about["n"] / 7).tobytes()]
        in_the_middle += (tmp_path / ".checkpoint.new").exists()
    assert in_the_middle
