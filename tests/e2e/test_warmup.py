"""Warming up loads every kernel that a flight with faults then calls."""

import subprocess
import sys

CODE = """
import sys
from pathlib import Path
from monitor.analyze import analyze_log
from monitor.settings import load
from monitor.warmup import warm_up

def loaded():
    modules = [m for name, m in list(sys.modules.items()) if name.startswith("estimators")]
    return {
        f"{f.__module__}.{f.__name__}": len(f.signatures)
        for m in modules for f in vars(m).values() if hasattr(f, "signatures")
    }

settings = load()
warm_up(settings)
before = loaded()
analysis = analyze_log(Path(sys.argv[1]), settings)
assert analysis.faults, "the flight has faults"
late = {name: n for name, n in loaded().items() if n != before.get(name, 0)}
print("LATE", late)
"""


def test_no_kernel_is_left_to_be_loaded_in_flight(flight_log):
    done = subprocess.run(
        [sys.executable, "-c", CODE, str(flight_log)], capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "LATE {}"
