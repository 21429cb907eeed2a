"""Objects of the pipeline as data, and data as objects again.

:func:`flatten` walks from an object over everything that it holds and writes it down as a tree of
plain values, with the bytes of its arrays beside it; :func:`rebuild` makes the objects again.
Objects that several others hold (the watches' parts share one bank) are written once and shared
again afterwards.

**Why no pickle.** A pickle is a program: it calls what it names, and an unpickler that admits a
list of names still calls those with whatever arguments the file has. Here a file can only name a
class from a table that the running program made (:func:`classes_of` of a freshly built pipeline);
it is made without calling its constructor, gets attributes and nothing else,
and :func:`fit` then holds it against the freshly built one: compiled code does not check its
bounds, so each array that it works on must be of the type and shape that it expects.

What belongs to the running process rather than to what was learnt (callables, moments of the host's
clock) a class names in ``fleeting``: it is not written, and taken from the freshly built object.
"""

from __future__ import annotations

import sys
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from enum import Enum
from functools import cache
from operator import attrgetter
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np

from monitor.settings.base import Section

__all__ = ["Damaged", "Flat", "Unstorable", "classes_of", "fit", "flatten", "rebuild"]

F = TypeVar("F", bound=Callable[..., Any])
_PACKAGES = frozenset({"monitor", "estimators", "links"})
_SCALARS = frozenset({type(None), bool, int, float, str})
_SEVERAL: dict[type, str] = {
    list: "list",
    tuple: "tuple",
    set: "set",
    frozenset: "frozenset",
    deque: "deque",
    dict: "dict",
    Counter: "counter",
}


class Unstorable(TypeError):
    """The object holds something that is no data; the sentence says where."""


class Damaged(ValueError):
    """The data make no such object; the sentence says why."""


class Flat(NamedTuple):
    """An object as data.

    Attributes
    ----------
    tree
        A plain value, or a list of what it is (``"object"``, ``"array"`` ...) and its parts.
    shapes
        Class and attributes of the objects; the tree refers to them by number.
    heads
        dtype, shape and whether it can be written to, of each array.
    arrays
        Bytes of each array, C order.
    """

    tree: Any
    shapes: list[list[Any]]
    heads: list[list[Any]]
    arrays: list[bytes]


def flatten(value: object) -> Flat:
    """Write an object down; it may change afterwards.

    Raises
    ------
    Unstorable
        Something in it is neither data nor an object of ours.
    """
    writer = _Writer()
    tree = writer.put(value)
    heads = [[_description(a.dtype), a.shape, a.flags.writeable] for a in writer.arrays]
    shapes = [[_name(cls), *names] for cls, names in writer.shapes]
    return Flat(tree, shapes, heads, writer.copies)


def rebuild(flat: Flat, classes: Mapping[str, type]) -> Any:
    """The object again.

    Parameters
    ----------
    flat
        As :func:`flatten` gave it, or read from a file.
    classes
        Those that it may have objects of, by name; see :func:`classes_of`.

    Raises
    ------
    Damaged
        It names another class, or is no such tree.
    """
    try:
        return _Reader(flat, classes).get(flat.tree)
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, RecursionError) as error:
        raise Damaged(f"no such object: {error!r}") from None


def classes_of(*values: object) -> dict[str, type]:
    """Classes that these objects can come to hold, by name.

    Those of everything that they hold now, the classes among them, and the classes that stand in
    the modules of either: an object makes others of what its module has.
    """
    found: dict[str, type] = {}
    seen: dict[int, object] = {}
    waiting = list(values)
    while waiting:
        value = waiting.pop()
        if id(value) in seen:
            continue
        seen[id(value)] = value  # kept, so that no other object gets its id
        cls: Any = value if isinstance(value, type) else type(value)
        if _ours(cls):
            found[_name(cls)] = cls
        if not isinstance(value, type):
            waiting += (part for _, part in _parts(value))
    for module in {sys.modules[cls.__module__] for cls in found.values()}:
        beside = [cls for cls in vars(module).values() if isinstance(cls, type) and _ours(cls)]
        found |= {_name(cls): cls for cls in beside}
    return found


def fit(fresh: object, found: object) -> None:
    """Hold a rebuilt object against a freshly built one, and give it what is fleeting of that.

    Raises
    ------
    Damaged
        They are not of one kind, or an array is not of the type or shape that the code expects.
    """
    _fit(fresh, found, type(fresh).__name__, set())


class _Writer:
    """Writes one tree."""

    def __init__(self) -> None:
        self.shapes: dict[tuple[type, tuple[str, ...]], int] = {}
        self.arrays: list[np.ndarray[Any, Any]] = []
        self.copies: list[bytes] = []
        self._known: dict[int, int] = {}  # id -> number, of what can be shared
        self._kept: list[object] = []  # temporary objects must not give their id to another

    def put(self, value: Any) -> Any:
        cls: Any = type(value)
        if cls in _SCALARS:
            return value
        known = self._known
        if (number := known.get(id(value))) is not None:
            return ["same", number]
        if cls is tuple:
            return ["tuple", *self._all(value)]
        if issubclass(cls, Enum):
            return ["enum", _name(cls), value.name]
        known[id(value)] = len(known)
        self._kept.append(value)
        if cls is np.ndarray:
            self.arrays.append(value)
            self.copies.append(value.tobytes())
            return ["array", len(self.arrays) - 1]
        if cls in _SEVERAL:
            if cls is dict or cls is Counter:
                parts = [part for pair in value.items() for part in pair]
                return [_SEVERAL[cls], *self._all(parts)]
            if cls is deque:
                return ["deque", value.maxlen, *self._all(value)]
            return [_SEVERAL[cls], *self._all(value)]
        if isinstance(value, np.generic):
            self.arrays.append(array := np.asarray(value))
            self.copies.append(array.tobytes())
            return ["scalar", len(self.arrays) - 1]
        if isinstance(value, bytes):
            return ["bytes", value.hex()]
        return self._object(cls, value)

    def _all(self, values: Any) -> list[Any]:
        put, scalars = self.put, _SCALARS
        return [value if type(value) in scalars else put(value) for value in values]

    def _object(self, cls: Any, value: Any) -> list[Any]:
        if not _ours(cls):
            raise Unstorable(f"{cls.__module__}.{cls.__qualname__} is no data")
        if issubclass(cls, Section):
            return ["settings", _name(cls), value.model_dump(mode="json")]
        names, get = _reader_of(cls)
        if get is None:
            if not hasattr(value, "__dict__"):
                raise Unstorable(f"{cls.__module__}.{cls.__qualname__} is no data")
            own: dict[str, Any] = vars(value)
            gone = _fleeting(cls)
            names = tuple(own) if not gone else tuple(name for name in own if name not in gone)
            parts: Sequence[Any] = [own[name] for name in names]
        else:
            parts = get(value)
        shape = self.shapes.setdefault((cls, names), len(self.shapes))
        try:
            return ["object", shape, *self._all(parts)]
        except Unstorable as error:
            raise Unstorable(f"{cls.__name__}: {error}") from None


class _Reader:
    """Reads one tree."""

    def __init__(self, flat: Flat, classes: Mapping[str, type]) -> None:
        self._classes = classes
        self._shapes = [(self._class(name), tuple(names)) for name, *names in flat.shapes]
        self._arrays = [
            _array(head, data) for head, data in zip(flat.heads, flat.arrays, strict=True)
        ]
        self._known: list[Any] = []

    def _class(self, name: str) -> type:
        if name not in self._classes:
            raise Damaged(f"there is no {name} in it")
        return self._classes[name]

    def get(self, node: Any) -> Any:
        if type(node) in _SCALARS:
            return node
        what, *parts = node
        match what:
            case "same":
                return self._known[parts[0]]
            case "tuple":
                return tuple(map(self.get, parts))
            case "enum":
                return self._enum(*parts)
            case "array" | "scalar":
                array = self._arrays[parts[0]]
                self._known.append(array if what == "array" else array[()])
                return self._known[-1]
            case "bytes":
                self._known.append(bytes.fromhex(parts[0]))
                return self._known[-1]
            case "settings":
                section = self._class(parts[0])
                if not issubclass(section, Section):
                    raise Damaged(f"{section.__name__} is no section of the settings")
                self._known.append(section.model_validate(parts[1]))
                return self._known[-1]
            case "object":
                return self._object(self._shapes[parts[0]], parts[1:])
            case _:
                return self._several(what, parts)

    def _enum(self, name: str, member: str) -> Enum:
        cls = self._class(name)
        if not issubclass(cls, Enum):
            raise Damaged(f"{name} is no list of names")
        return cls[member]

    def _several(self, what: str, parts: Sequence[Any]) -> Any:
        """Containers are known before their parts are read: a part may refer to its container."""
        at = len(self._known)
        self._known.append(None)
        held: Any
        match what:
            case "list":
                held = self._known[at] = []
                held.extend(map(self.get, parts))
            case "deque":
                held = self._known[at] = deque(maxlen=parts[0])
                held.extend(map(self.get, parts[1:]))
            case "dict" | "counter":
                held = self._known[at] = {} if what == "dict" else Counter()
                for key, value in zip(parts[::2], parts[1::2], strict=True):
                    key = self.get(key)
                    held[key] = self.get(value)
            case "set":
                held = self._known[at] = set()
                held.update(map(self.get, parts))
            case "frozenset":
                held = self._known[at] = frozenset(map(self.get, parts))
            case _:
                raise Damaged(f"{what!r} is nothing that can be read")
        return held

    def _object(self, shape: tuple[type, tuple[str, ...]], parts: Sequence[Any]) -> Any:
        cls, names = shape
        at = len(self._known)
        self._known.append(None)
        if issubclass(cls, tuple):
            self._known[at] = cls.__new__(cls, *map(self.get, parts))
            return self._known[at]
        if issubclass(cls, Section | Enum):
            raise Damaged(f"{cls.__name__} is made in another way")
        held = self._known[at] = object.__new__(cls)
        slots = _slots(cls)
        for name, part in zip(names, parts, strict=True):
            if slots and name not in slots:
                raise Damaged(f"{cls.__name__} has no {name}")
            object.__setattr__(held, name, self.get(part))
        return held


def _array(head: Sequence[Any], data: bytes) -> np.ndarray[Any, Any]:
    """An array of its own, aligned memory."""
    description, shape, writeable = head
    dtype = np.lib.format.descr_to_dtype(_tuples(description))
    if dtype.hasobject:
        raise Damaged("an array of objects")
    array = np.frombuffer(data, dtype).reshape([int(n) for n in shape]).copy()
    array.flags.writeable = bool(writeable)
    return array


def _once(function: F) -> F:
    """``functools.cache`` that keeps the function's type."""
    return cast(F, cache(function))


@_once
def _description(dtype: np.dtype[Any]) -> Any:
    if dtype.hasobject:
        raise Unstorable("an array of objects is no data")
    return np.lib.format.dtype_to_descr(dtype)


def _tuples(description: Any) -> Any:
    """A dtype's description as it was before JSON made lists of its tuples."""
    if isinstance(description, str):
        return description
    return [
        (field[0], _tuples(field[1]), *(tuple(shape) for shape in field[2:]))
        for field in description
    ]


def _fit(fresh: Any, found: Any, where: str, seen: set[tuple[int, int]]) -> None:
    if fresh is None or (id(fresh), id(found)) in seen:
        return
    cls: Any = type(fresh)
    if cls is np.ndarray:
        if type(found) is not np.ndarray or (found.dtype, found.ndim) != (fresh.dtype, fresh.ndim):
            raise Damaged(f"{where} is not what it should be")
        return
    if _ours(cls) and not issubclass(cls, Enum | Section):
        if type(found) is not cls:
            raise Damaged(f"{where} is not what it should be")
        seen.add((id(fresh), id(found)))
        for name in _fleeting(cls):
            object.__setattr__(found, name, getattr(fresh, name))
        for name, part in _parts(fresh):
            if not hasattr(found, name):
                raise Damaged(f"{where}.{name} is missing")
            other, place = getattr(found, name), f"{where}.{name}"
            _fit(part, other, place, seen)
            # what compiled code works on comes as named tuples of arrays, all made once
            sized = issubclass(cls, tuple) and isinstance(part, np.ndarray)
            if sized and part.shape != other.shape:
                raise Damaged(f"{place} is of another size")
    elif cls in (list, tuple):
        if type(found) is cls and len(found) == len(fresh):
            for k, (part, other) in enumerate(zip(fresh, found, strict=True)):
                _fit(part, other, f"{where}[{k}]", seen)
    elif cls is dict and type(found) is dict:
        for key in fresh.keys() & found.keys():
            _fit(fresh[key], found[key], f"{where}[{key!r}]", seen)


def _parts(value: object) -> Iterator[tuple[str, Any]]:
    """What an object holds, by name; nothing of what is fleeting."""
    if isinstance(value, dict):
        yield from (("", part) for pair in value.items() for part in pair)
    elif isinstance(value, tuple) and hasattr(value, "_fields"):
        yield from zip(value._fields, value, strict=True)
    elif isinstance(value, list | tuple | set | frozenset | deque):
        yield from (("", part) for part in value)
    elif isinstance(value, Section):
        yield from ((name, getattr(value, name)) for name in type(value).model_fields)
    elif _ours(type(value)) and not isinstance(value, Enum):
        gone = _fleeting(type(value))
        names = [*_slots(type(value)), *getattr(value, "__dict__", ())]
        yield from ((name, getattr(value, name)) for name in names if name not in gone)


@_once
def _ours(cls: Any) -> bool:
    return cls.__module__.partition(".")[0] in _PACKAGES


@_once
def _name(cls: Any) -> str:
    return f"{cls.__module__}.{cls.__qualname__}"


@_once
def _fleeting(cls: Any) -> tuple[str, ...]:
    return tuple(getattr(cls, "fleeting", ()))


@_once
def _slots(cls: Any) -> tuple[str, ...]:
    return tuple(name for base in cls.__mro__ for name in getattr(base, "__slots__", ()))


@_once
def _reader_of(cls: Any) -> tuple[tuple[str, ...], Callable[[Any], Sequence[Any]] | None]:
    """Attributes of a class whose objects all have the same ones, and how they are read at once."""
    if issubclass(cls, tuple):
        names: tuple[str, ...] = getattr(cls, "_fields", ())
        return names, tuple
    names = tuple(name for name in _slots(cls) if name not in _fleeting(cls))
    if not names:
        return (), None
    if len(names) == 1:
        one = attrgetter(names[0])
        return names, lambda value: (one(value),)
    return names, attrgetter(*names)
