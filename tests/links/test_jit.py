"""Machine code that several processes keep in one place at once."""

import os
import subprocess
import sys

MODULE = """
from links.jit import kernel

@kernel
def twice(x):
    return x + x
"""

CODE = """
import sys
import time
from numba.core.caching import IndexDataCacheFile as Index
save = Index._save_index
Index._save_index = lambda *arguments: (time.sleep(0.5), save(*arguments))  # all are there by then
sys.path.insert(0, sys.argv[1])
from kernel_under_test import twice
kind = {"int": int, "float": float, "complex": complex}[sys.argv[2]]
assert twice(kind(21)) == 42 and type(twice(kind(21))) is kind
print(sum(twice._cache_misses.values()))
"""


def test_signatures_of_one_kernel_compiled_at_once_do_not_take_each_others_code(tmp_path):
    (tmp_path / "kernel_under_test.py").write_text(MODULE)
    own = os.environ | {"MAVSENTRY_CACHE_DIR": str(tmp_path / "kernels")}

    def run(kind):
        arguments = [sys.executable, "-c", CODE, str(tmp_path), kind]
        return subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True, env=own)

    kinds = ("int", "float", "complex")
    compiled = [run(kind) for kind in kinds]
    assert [process.communicate(timeout=60)[0] for process in compiled] == ["1\n"] * 3
    loaded = [run(kind) for kind in kinds]
    assert [process.communicate(timeout=60)[0] for process in loaded] == ["0\n"] * 3


ONCE = """
import sys
sys.path.insert(0, sys.argv[1])
from kernel_under_test import twice
from links.jit import unkept
assert twice(21) == 42
print(sum(twice._cache_hits.values()), unkept())
"""


def once(folder, cache):
    """A process of its own calls the kernel: how often it was found in the cache, what failed."""
    (folder / "kernel_under_test.py").write_text(MODULE)
    done = subprocess.run(
        [sys.executable, "-c", ONCE, str(folder)],
        capture_output=True,
        text=True,
        timeout=60,
        env=os.environ | {"MAVSENTRY_CACHE_DIR": str(cache)},
    )
    assert done.returncode == 0, done.stderr
    hits, _, why = done.stdout.strip().partition(" ")
    return int(hits), why


def kept(cache):
    return {path: path.stat().st_mtime_ns for path in cache.rglob("*")}


def test_a_cache_that_is_there_is_read_without_writing_anything(tmp_path):
    cache = tmp_path / "kernels"
    assert once(tmp_path, cache) == (0, "None")
    before = kept(cache)
    assert any(path.suffix == ".nbi" for path in before)
    assert once(tmp_path, cache) == (1, "None")
    assert kept(cache) == before  # nothing touched: a read-only file system would do


def test_where_nothing_can_be_kept_kernels_are_compiled_and_it_is_told(tmp_path):
    (tmp_path / "file").write_text("not a folder")
    assert once(tmp_path, tmp_path / "file" / "kernels") == (0, "Not a directory")
    assert not list(tmp_path.rglob("*.nbi"))  # and nowhere else, such as beside the source


def test_machine_code_cut_off_by_a_power_cut_is_compiled_anew(tmp_path):
    cache = tmp_path / "kernels"
    once(tmp_path, cache)
    for index in cache.rglob("*.nbi"):
        index.write_bytes(index.read_bytes()[:-20])
    assert once(tmp_path, cache) == (0, "None")
    (code,) = cache.rglob("*.nbc")
    code.write_bytes(code.read_bytes()[:100])
    assert once(tmp_path, cache) == (0, "None")
    assert once(tmp_path, cache) == (1, "None")
