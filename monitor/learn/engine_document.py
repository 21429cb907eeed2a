"""A learnt engine model as a file that ``--config`` takes."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping
from typing import Any

from monitor.learn.engine import EngineLearnt
from monitor.toml import toml_value

__all__ = ["engine_document"]

WIDTH = 96


def engine_document(learnt: EngineLearnt, carried: Mapping[str, Any]) -> str:
    """The file as TOML.

    Parameters
    ----------
    learnt
        The model.
    carried
        Tables of the file that it was learnt over: they are kept, the engine's replaced.
    """
    engine = {k: v for k, v in carried.get("engine", {}).items() if not isinstance(v, Mapping)}
    rest = {k: v for k, v in carried.items() if k != "engine"}
    lines = [
        *(f"# {line}" for line in textwrap.wrap(_rests_on(learnt), WIDTH - 2)),
        *(f"{k} = {toml_value(v)}" for k, v in rest.items() if not isinstance(v, Mapping)),
        "",
        "[engine]",
        *(f"{k} = {toml_value(v)}" for k, v in engine.items() if k != "model"),
        'model = "single-shaft"',
        "",
        "[engine.single_shaft]",
        "# speed = c0 + c1 t + c2 t^2 + c3 V + c4 t V after the time constant; t throttle, V m/s",
        *(f"{k} = {toml_value(v)}" for k, v in learnt.settings.model_dump().items()),
    ]
    for sensor, channel in learnt.channels.items():
        lines += ["", f"[engine.channels.{sensor}]"]
        lines += [f"{k} = {toml_value(v)}" for k, v in channel.model_dump().items()]
    for key, value in rest.items():
        if isinstance(value, Mapping):
            lines += ["", *_table(key, value)]
    return "\n".join(lines) + "\n"


def _rests_on(learnt: EngineLearnt) -> str:
    fit = learnt.fit
    crossed = ""
    if not math.isnan(fit.crossed_rpm):
        crossed = f", {fit.crossed_rpm:.3g} rpm on flights left out of the fit"
    alike = ""
    if learnt.alike:
        alike = (
            f" {' and '.join(learnt.alike)} read the same and are taken for channels of one "
            "shaft: if they are those of two engines, give them shafts of their own."
        )
    return (
        f"Engine model learnt from {len(learnt.flights)} healthy flights "
        f"({', '.join(learnt.flights)}; {learnt.seconds / 60.0:.1f} min in the air) by `mavsentry "
        f"learn engine`. Throttle and airspeed explain {100.0 * fit.explained:.1f} % of the "
        f"speed's variance; error {fit.rms_rpm:.3g} rpm{crossed}.{alike}"
    )


def _table(name: str, values: Mapping[str, Any]) -> list[str]:
    """A table with its subtables after its own keys."""
    lines = [f"[{name}]"]
    lines += [f"{k} = {toml_value(v)}" for k, v in values.items() if not isinstance(v, Mapping)]
    for key, value in values.items():
        if isinstance(value, Mapping):
            lines += ["", *_table(f"{name}.{key}", value)]
    return lines
