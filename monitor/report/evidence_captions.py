"""What to look at in each chart of a finding, in sentences with numbers of that flight."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from links.vocabulary import Kind
from monitor.pages.html import clock
from monitor.pages.units import on_screen
from monitor.report.evidence_data import Family, Limit
from monitor.report.evidence_numbers import mean_over, value_at
from monitor.report.evidence_scene import Scene
from monitor.report.evidence_words import size_words
from monitor.report.series import Series
from monitor.report.wording import lasting

__all__ = [
    "apart",
    "change_sentence",
    "error",
    "inertial",
    "level",
    "measured",
    "motion",
    "others",
    "ratio",
    "scatter",
    "signed",
    "slope",
    "wind",
]

REACHED: Final = 1.0 - 1e-6
"""A ratio this near to 1 is at its threshold."""
AGREED: Final = 0.5
"""Others that changed by less than this share of an error did not see it."""
_UNSIZED: Final = (Kind.STUCK, Kind.NOISE, Kind.OSCILLATION, Kind.DROPOUT)
"""Faults that are not told by the size of an error."""


def signed(value: float, unit: str) -> str:
    """``+0.3 m/s``, ``−4.7 m/s``."""
    words = size_words(value, unit)
    return words if not math.isfinite(value) else ("+" if value >= 0.0 else "−") + words


def measured(scene: Scene) -> str:
    """Of the first chart: how well it agreed before, and what it read when it was named."""
    case, unit = scene.case, scene.subject.unit
    at_s = scene.said_s
    reads, should = value_at(scene.own, at_s), value_at(scene.expected, at_s)
    std = value_at(scene.expected_std, at_s)
    if scene.own is None:
        return "What it measured was not recorded."
    if not math.isfinite(should):
        read = f"{scene.when} it read {_value(reads, unit)}" if math.isfinite(reads) else ""
        return f"{read or 'It sent nothing then'}. Nothing told then what it should have shown."
    give = f" ± {size_words(2.0 * std, unit)}" if math.isfinite(std) else ""
    read = f"{scene.when} it read {_value(reads, unit)} where {_value(should, unit)}{give} "
    before = _agreement(scene)
    said = (
        f"Until {clock(case.onset_s)} it was within {size_words(before, unit)} of what it should "
    )
    said = f"{said}have shown, half of the time. " if math.isfinite(before) else ""
    said = f"{said}{read}was expected (2σ)."
    if scene.from_estimate is not None and scene.from_estimate.table == "air":
        return f"{said} That is the aircraft's own; what was learnt of this sensor is not in it."
    return said


def _agreement(scene: Scene) -> float:
    """Median of the difference's size before the onset."""
    error = scene.error
    if error is None or scene.subject.error is not None:
        return math.nan
    before = error.middle[(error.t_s < scene.case.onset_s - 0.5) & np.isfinite(error.middle)]
    return float(np.median(np.abs(before))) if before.size else math.nan


def error(scene: Scene, limit: Limit | None) -> str:
    """Of the second chart: the error when it was named, and the size that it must exceed."""
    unit = scene.subject.unit
    size, std = value_at(scene.error, scene.said_s), value_at(scene.error_std, scene.said_s)
    give = f" ± {size_words(2.0 * std, unit)} (2σ)" if math.isfinite(std) else ""
    said = f"{scene.when} the error was {signed(size, unit)}{give}."
    if not math.isfinite(size):
        said = f"{scene.when} the error was not known."
    if limit is not None:
        low, high = (float(b) for b in limit.bounds(value_at(scene.expected, scene.said_s)))
        bound = high if size >= 0.0 or not math.isfinite(low) else low
        if math.isfinite(bound):
            said += f" A fault must pass {signed(bound, unit)} ({limit.key})."
    if scene.case.kind in _UNSIZED:
        return f"{said} Its size says little here: look at how it moves."
    if scene.subject.family in (Family.ACC, Family.GYRO):
        return (
            f"{said} The filters believe the sensor until it is named and take its error over "
            "then, within some seconds; the small bias that they had learnt before is in it."
        )
    return f"{said} Look where the band leaves zero, and stays away."


def ratio(scene: Scene, series: Series, blame: Series | None) -> str:
    """Of the third chart: when the statistic passed its threshold, and how far."""
    case = scene.case
    after = series.t_s >= case.onset_s - 0.5
    loud = after & (series.high >= REACHED)
    until = case.until(scene.flight.duration_s)
    during = after & (series.t_s <= min(until, scene.group.to_s)) & np.isfinite(series.high)
    before = np.isfinite(series.high) & (series.t_s < case.onset_s - 0.5)
    quiet = float(series.high[before].max()) if before.any() else math.nan
    said = f"Before the onset it reached {quiet:.2g}. " if math.isfinite(quiet) else ""
    if not loud.any():
        return f"{said}It did not reach 1 within this time: the verdict rests on another test."
    first_s = float(series.t_s[int(loud.argmax())])
    most = float(series.high[during].max()) if during.any() else float(series.high[loud].max())
    delay = lasting(max(first_s - case.onset_s, 0.0))
    said = f"{said}It reached 1, its threshold, {delay} after the onset and went up to {most:.3g}."
    if blame is not None and np.isfinite(blame.high).any():
        said += (
            " That is the dispute with the other IMU, which counts for both; the odds say whose "
            f"fault it is, and reached {float(np.nanmax(blame.high)):.2g} times what decides."
        )
    return (
        f"{said} From the verdict on it is held against the sensor's return: the sensor is "
        "believed again some time after it has fallen below 1."
    )


def others(scene: Scene, changes: list[tuple[str, Series | None]]) -> str:
    """Of the fourth chart: by how much the others changed while the error appeared."""
    size, unit = scene.case.found.get("magnitude"), scene.subject.unit
    own = scene.change(scene.own)
    told = [(name, scene.change(series)) for name, series in changes if series is not None]
    told = [(name, by) for name, by in told if math.isfinite(by)]
    if not told:
        return "Had it been real, the others would have seen it too."
    said = f"{_changed([(name, by, unit) for name, by in told])}."
    if not math.isfinite(own):
        return said
    said = f"{_changed([(name, by, unit) for name, by in [(scene.case.sensor, own), *told]])}."
    alike = [by for name, by in told if not name.startswith("GPS")]
    if size is None or scene.case.kind in _UNSIZED or not alike:
        return said
    if all(abs(by - own) > AGREED * abs(size) for by in alike):
        return f"{said} The others of its kind did not follow it."
    return said


def inertial(scene: Scene, mean: Series | None, freed: Series | None) -> str:
    """Of an IMU's first chart: both means just after the verdict."""
    unit = scene.subject.unit
    reads, should = value_at(mean, scene.said_s), value_at(freed, scene.said_s)
    if not math.isfinite(reads):
        return "It gave no samples when it was named."
    said = f"{scene.when} it read {_value(reads, unit)} on average over a second"
    if scene.case.kind is Kind.NOISE:
        return f"{said}: a mean hides what scatters, the samples about it show it."
    if not math.isfinite(should):
        return f"{said}; what it should have read was not estimated then."
    return (
        f"{said}, where {_value(should, unit)} remain once the reconstructed error is taken off."
        " Up to the verdict the two are one: the filters still believed the sensor."
    )


def apart(scene: Scene, told: list[tuple[str, Series]]) -> str:
    """Of differences within a kind: each before the onset and after the verdict."""
    case, unit = scene.case, scene.subject.unit
    said = []
    for name, series in told:
        before = mean_over(series, case.onset_s - 5.0, case.onset_s - 0.5)
        after = mean_over(series, case.isolated_s + 0.5, case.isolated_s + 3.5)
        if math.isfinite(before + after):
            said.append(f"{name} went from {_value(before, unit)} to {_value(after, unit)}")
    if not said:
        return "Compare them before the onset and after it."
    which = " What the others have between them did not change with it." if len(said) > 2 else ""
    return f"{', '.join(said)} across the onset.{which}"


def motion(scene: Scene, named: Sequence[tuple[str, Series | None, str]], unit: str) -> str:
    """Of the motion: what the error would have made of it, and what was seen."""
    size = scene.case.found.get("magnitude")
    said = change_sentence(scene, named)
    if scene.case.kind in (Kind.STUCK, Kind.DROPOUT):
        return f"While the aircraft moves, no sensor stands still. {said}"
    if size is None or scene.case.kind in _UNSIZED:
        return said or "How the aircraft moved meanwhile."
    if unit == "m":
        height = size_words(50.0 * size, "m")
        return f"Taken for real, the error would have made {height} of height in 10 s. {said}"
    return f"Taken for real, the error would have made {signed(10.0 * size, unit)} in 10 s. {said}"


def wind(scene: Scene, north: Series | None, east: Series | None) -> str:
    """Of the wind: whether it changed, which would be the other explanation."""
    by_n, by_e = scene.change(north), scene.change(east)
    if not math.isfinite(by_n + by_e):
        return "A pitot that is wrong and a wind that changed look alike along one course: compare."
    moved = math.hypot(by_n, by_e)
    size = scene.case.found.get("magnitude")
    said = (
        f"Across the onset the estimated wind changed by {size_words(moved, 'm/s')} "
        f"(north {signed(by_n, 'm/s')}, east {signed(by_e, 'm/s')})"
    )
    if size is None or scene.case.kind in _UNSIZED:
        return f"{said}."
    if scene.subject.family is Family.PITOT:
        if moved < AGREED * abs(size):
            return f"{said}: too little to explain {size_words(size, 'm/s')}."
        return f"{said}, the error being {size_words(size, 'm/s')}."
    return f"{said}."


def scatter(scene: Scene, series: Series, peers: list[tuple[str, Series]]) -> str:
    """Of what scatters: before and after, beside the others of its kind."""
    case, unit = scene.case, scene.subject.unit
    end_s = min(case.until(scene.flight.duration_s), scene.group.to_s)
    before = mean_over(series, scene.group.from_s, case.onset_s - 1.0)
    after = mean_over(series, case.onset_s, end_s)
    said = f"{case.sensor} moved by {size_words(before, unit)} within a second before the onset"
    said = f"{said} and by {size_words(after, unit)} from it on"
    for name, peer in peers:
        said += f"; {name} by {size_words(mean_over(peer, case.onset_s, end_s), unit)} meanwhile"
    return f"{said}."


def change_sentence(scene: Scene, named: Sequence[tuple[str, Series | None, str]]) -> str:
    """By how much some quantities changed across the onset: name, series, unit."""
    told = [(name, scene.change(series), unit) for name, series, unit in named]
    told = [(name, by, unit) for name, by, unit in told if math.isfinite(by)]
    return f"{_changed(told)}." if told else ""


def _changed(told: list[tuple[str, float, str]]) -> str:
    """``Across the onset airspeed1 changed by +0.3 m/s, GPS ground speed by −0.1 m/s``."""
    (name, by, unit), *more = told
    said = f"Across the onset {name} changed by {signed(by, unit)}"
    return ", ".join([said, *(f"{name} by {signed(by, unit)}" for name, by, unit in more)])


def level(series: Series, from_s: float, to_s: float) -> str:
    """What a series was on average between two moments."""
    mean = mean_over(series, from_s, to_s)
    if not math.isfinite(mean):
        return ""
    return f"From the onset to the verdict it was {_value(mean, series.unit)} on average."


def slope(series: Series, from_s: float, to_s: float) -> str:
    """How fast a height changed between two moments, by its means about them."""
    first, last = (
        mean_over(series, from_s - 1.0, from_s + 1.0),
        mean_over(series, to_s - 1.0, to_s + 1.0),
    )
    if not math.isfinite(last - first) or to_s - from_s < 1.0:
        return ""
    rate = (last - first) / (to_s - from_s)
    return f"From the onset to the verdict it changed by {signed(rate, 'm/s')}."


def _value(value: float, unit: str) -> str:
    """A value with its sign where it is negative."""
    if not math.isfinite(value):
        return "nothing"
    factor, _ = on_screen(unit)
    return ("−" if value * factor < -0.005 else "") + size_words(value, unit)
