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
