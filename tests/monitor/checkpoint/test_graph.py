"""Objects to data and back: shared ones stay shared, and nothing else than data comes out."""

import json
import sys
from collections import Counter, deque
from dataclasses import dataclass
from itertools import pairwise
from types import ModuleType
from typing import ClassVar, NamedTuple

import numpy as np
import pytest

from links.vocabulary import Kind, State
from monitor.checkpoint.graph import Damaged, Flat, Unstorable, classes_of, fit, flatten, rebuild
from monitor.pipeline import Pipeline
from monitor.settings import load
from monitor.settings.streams import StreamSettings
from monitor.verdict import AIR_ESTIMATE, Verdict


class Bank(NamedTuple):
    x: np.ndarray
    P: np.ndarray


@dataclass(slots=True)
class Part:
    bank: Bank
    beside: object = None


class Whole:
    fleeting: ClassVar = ("say",)

    def __init__(self):
        self.say = print
        self.bank = Bank(np.arange(3.0), np.eye(3))
        self.parts = [Part(self.bank), Part(self.bank)]


for _cls in (Bank, Part, Whole):
    _cls.__module__ = "monitor.made_up"
    sys.modules.setdefault("monitor.made_up", ModuleType("monitor.made_up"))

CLASSES = classes_of(
    Whole(), Part(Bank(np.zeros(1), np.zeros(1))), Verdict, State, Kind, StreamSettings
)


def through(value):
    """As a file has it."""
    flat = flatten(value)
    told = json.loads(json.dumps([flat.tree, flat.shapes, flat.heads]))
    return rebuild(Flat(*told, flat.arrays), CLASSES)


@pytest.mark.parametrize(
    "value",
    [
        None,
        True,
        -(1 << 62),
        0.1,
        float("inf"),
        "a\udcff",
        b"\x00\xff",
        (1, ("a", None)),
        [1, [2.5]],
        {("imu0", 3): [1], "b": {}},
        {1, 2},
        frozenset({"a"}),
        Counter({("frame", State.OK): 3}),
        deque([1, 2], maxlen=2),
        State.FAULTY,
        Verdict(3, "imu0.acc_x", State.FAULTY, magnitude=1e-300),
        StreamSettings(horizon_s=0.25),
    ],
    ids=repr,
)
def test_plain_values_come_back_as_they_were(value):
    found = through(value)
    assert found == value or repr(found) == repr(value)
    assert type(found) is type(value)
    assert getattr(found, "maxlen", None) == getattr(value, "maxlen", None)


@pytest.mark.parametrize(
    "array",
    [
        np.array([0.1, np.nan, -0.0]),
        np.zeros((0, 3)),
        np.arange(6, dtype=np.int32).reshape(2, 3),
        np.zeros(2, AIR_ESTIMATE),
        np.array([b"ARSPD_RATIO"]),
        np.arange(6.0).reshape(2, 3).T,
    ],
    ids=lambda a: f"{a.dtype.kind}{a.shape}",
)
def test_arrays_come_back_to_the_bit_in_memory_of_their_own(array):
    found = through([array])[0]
    assert (found.dtype, found.shape) == (array.dtype, array.shape)
    assert found.tobytes() == array.tobytes()
    assert found.flags.owndata
    assert found.flags.aligned
    assert found.flags.writeable


def test_an_array_that_must_not_change_stays_so():
    array = np.arange(3.0)
    array.flags.writeable = False
    assert not through([array])[0].flags.writeable


def test_a_numpy_scalar_stays_one():
    row = np.zeros(1, AIR_ESTIMATE)[0].copy()
    row["cas_m_s"] = 21.5
    found = through({"air": row, "x": np.float64(0.1)})
    assert type(found["air"]) is np.void
    assert found["air"] == row
    assert repr(found["x"]) == "np.float64(0.1)"


def test_what_is_shared_is_shared_again():
    whole = Whole()
    whole.parts[0].beside = whole.parts  # and one that holds itself
    found = through(whole)
    assert found.parts[0].bank is found.parts[1].bank is found.bank
    assert found.parts[0].beside is found.parts
    found.bank.x[0] = 7.0
    assert found.parts[1].bank.x[0] == 7.0
    assert whole.bank.x[0] == 0.0


def test_a_snapshot_does_not_change_with_what_it_is_of():
    whole = Whole()
    flat = flatten(whole)
    whole.bank.x[:] = 9.0
    whole.parts.clear()
    assert rebuild(flat, CLASSES).bank.x.tolist() == [0.0, 1.0, 2.0]
    assert len(rebuild(flat, CLASSES).parts) == 2


def test_what_is_fleeting_is_the_fresh_ones():
    whole, fresh = Whole(), Whole()
    whole.say = None
    found = through(whole)
    assert not hasattr(found, "say")
    fit(fresh, found)
    assert found.say is print


@pytest.mark.parametrize("value", [print, lambda: 0, object(), Whole, np.array([None])])
def test_what_is_no_data_is_refused_by_name(value):
    whole = Whole()
    whole.parts[1].beside = value
    with pytest.raises(Unstorable, match=r"Whole: |array of objects"):
        flatten(whole)


@pytest.mark.parametrize(
    ("tree", "shapes", "heads"),
    [
        (["object", 0, "true"], [["posix.system", "command"]], []),
        (["object", 0], [["builtins.eval"]], []),
        (["object", 0], [["monitor.made_up.Part", "__class__"]], []),
        (["object", 0, 1], [["monitor.made_up.Part", "no_such"]], []),
        (["enum", "monitor.made_up.Part", "mro"], [], []),
        (["enum", "links.vocabulary.State", "__class__"], [], []),
        (["settings", "monitor.made_up.Part", {}], [], []),
        (["settings", "monitor.settings.streams.StreamSettings", {"horizon_s": -1}], [], []),
        (["call", "print"], [], []),
        (["same", 3], [], []),
        (["array", 0], [], [["|O", [1], True]]),
        (["array", 0], [], [["<f8", [1 << 40], True]]),
        (["list", []], [], []),
        ({"a": 1}, [], []),
    ],
)
def test_a_file_that_asks_for_anything_else_gets_nothing(tree, shapes, heads):
    with pytest.raises(Damaged):
        rebuild(Flat(tree, shapes, heads, [b"\0" * 8] * len(heads)), CLASSES)


def test_a_nest_without_end_is_refused():
    tree: list = []
    for _ in range(100_000):
        tree = ["list", tree]
    with pytest.raises(Damaged):
        rebuild(Flat(tree, [], [], []), CLASSES)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda w: setattr(w, "bank", Bank(np.arange(2.0), w.bank.P)),
        lambda w: setattr(w, "bank", Bank(np.arange(3), w.bank.P)),
        lambda w: setattr(w, "bank", (w.bank.x, w.bank.P)),
        lambda w: delattr(w, "parts"),
        lambda w: w.parts.__setitem__(0, "a part"),
        lambda w: setattr(w.parts[0], "bank", Bank(w.bank.x, np.eye(2))),
    ],
)
def test_an_array_of_another_size_never_reaches_compiled_code(spoil):
    fit(Whole(), whole := through(Whole()))
    spoil(whole)
    with pytest.raises(Damaged, match="Whole"):
        fit(Whole(), whole)


def test_no_two_arrays_of_a_pipeline_share_memory_but_by_being_one():
    """Views of one another would come back as two."""
    arrays = {}
    waiting, seen = [Pipeline(load())], []
    from monitor.checkpoint.graph import _parts

    while waiting:
        value = waiting.pop()
        if any(value is s for s in seen):
            continue
        seen.append(value)
        if isinstance(value, np.ndarray):
            arrays[id(value)] = value
        else:
            waiting += [part for _, part in _parts(value)]
    spans = sorted(
        (np.lib.array_utils.byte_bounds(a) for a in arrays.values() if a.size), key=lambda s: s[0]
    )
    assert len(spans) > 100
    assert all(before[1] <= after[0] for before, after in pairwise(spans))
