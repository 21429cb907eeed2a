"""From sample batches to verdicts: pipeline, watches, daemon, log analysis, command line.

What other programs may build on stands in :data:`__all__`, and nothing else: modules and names
that are not listed there change without notice. Each name is loaded when it is first asked for, so
that ``import monitor`` alone loads neither numpy nor numba.

::

    from monitor import Monitor, load_settings

    sentry = Monitor(load_settings("small-uav"))
    for verdict in sentry.feed(datagram).verdicts:
        print(verdict.sensor, verdict.state, verdict.evidence)
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from links.logs import LogError, LogInfo, LogReader, open_log
    from links.mavlink import DecoderOptions, Vehicle
    from links.samples import QUANTITIES, Batch, Rows
    from links.vocabulary import Kind, Reason, Rejection, State
    from monitor.analyze import Analysis, analyze_log
    from monitor.arrays import ArraySource
    from monitor.embed import Monitor
    from monitor.estimate_files import EstimateSink
    from monitor.recording import Estimates
    from monitor.settings import PROFILES, Settings, SettingsError
    from monitor.settings import load as load_settings
    from monitor.verdict import StepResult, Verdict
    from monitor.warmup import warm_up

    __version__: str

__all__ = [
    "PROFILES",
    "QUANTITIES",
    "Analysis",
    "ArraySource",
    "Batch",
    "DecoderOptions",
    "EstimateSink",
    "Estimates",
    "Kind",
    "LogError",
    "LogInfo",
    "LogReader",
    "Monitor",
    "Reason",
    "Rejection",
    "Rows",
    "Settings",
    "SettingsError",
    "State",
    "StepResult",
    "Vehicle",
    "Verdict",
    "__version__",
    "analyze_log",
    "load_settings",
    "open_log",
    "warm_up",
]

_HOMES = {
    "links.logs": ("LogError", "LogInfo", "LogReader", "open_log"),
    "links.mavlink": ("DecoderOptions", "Vehicle"),
    "links.samples": ("QUANTITIES", "Batch", "Rows"),
    "links.vocabulary": ("Kind", "Reason", "Rejection", "State"),
    "monitor.analyze": ("Analysis", "analyze_log"),
    "monitor.arrays": ("ArraySource",),
    "monitor.embed": ("Monitor",),
    "monitor.estimate_files": ("EstimateSink",),
    "monitor.recording": ("Estimates",),
    "monitor.settings": ("PROFILES", "Settings", "SettingsError", "load as load_settings"),
    "monitor.verdict": ("StepResult", "Verdict"),
    "monitor.warmup": ("warm_up",),
}
"""Module -> public names that are taken from it; what is imported above for type checkers."""

_PLACES = {
    name.rpartition(" as ")[2]: (module, name.partition(" as ")[0])
    for module, names in _HOMES.items()
    for name in names
}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        value: Any = version("mavsentry")
    elif name in _PLACES:
        module, attribute = _PLACES[name]
        value = getattr(import_module(module), attribute)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
