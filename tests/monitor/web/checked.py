"""Whether a message is of the protocol's types: every key there, no other, each of its kind."""

import json
import types
import typing
from typing import NotRequired, get_args, get_origin, get_type_hints, is_typeddict

from monitor.web import protocol

KINDS = {"hello": protocol.Hello, "history": protocol.History, "frame": protocol.Frame}


def checked(message):
    """The message as a viewer reads it.

    Raises
    ------
    ValueError
        It is not of its type; the text says where.
    """
    read = json.loads(message) if isinstance(message, str | bytes) else message
    read = json.loads(json.dumps(read, allow_nan=False))
    check(read, KINDS[read["kind"]], read["kind"])
    return read


def check(value, kind, where):
    origin, inner = get_origin(kind), get_args(kind)
    if is_typeddict(kind):
        check_dict(value, kind, where)
    elif origin is NotRequired:
        check(value, inner[0], where)
    elif origin in (typing.Union, types.UnionType):
        if not any(holds(value, one) for one in inner):
            raise ValueError(f"{where}: {value!r} is none of {inner}")
    elif origin is typing.Literal:
        expect(value in inner, value, kind, where)
    elif origin in (list, tuple):
        expect(isinstance(value, list), value, kind, where)
        kinds = inner if origin is tuple else [inner[0]] * len(value)
        expect(len(kinds) == len(value), value, kind, where)
        for i, (one, expected) in enumerate(zip(value, kinds, strict=True)):
            check(one, expected, f"{where}[{i}]")
    elif origin is dict:
        expect(isinstance(value, dict), value, kind, where)
        for key, one in value.items():
            check(one, inner[1], f"{where}.{key}")
    elif kind in (float, int):
        number = isinstance(value, int) or (kind is float and isinstance(value, float))
        expect(number and not isinstance(value, bool), value, kind, where)
    else:
        expect(isinstance(value, kind), value, kind, where)


def check_dict(value, kind, where):
    expect(isinstance(value, dict), value, kind, where)
    hints = get_type_hints(kind, include_extras=True)
    if strange := set(value) - set(hints):
        raise ValueError(f"{where}: there is no key {min(strange)}")
    for key, expected in hints.items():
        if key in value:
            check(value[key], expected, f"{where}.{key}")
        elif get_origin(expected) is not NotRequired:
            raise ValueError(f"{where}: {key} is missing")


def holds(value, kind):
    if kind is type(None):
        return value is None
    try:
        check(value, kind, "")
    except ValueError:
        return False
    return True


def expect(true, value, kind, where):
    if not true:
        raise ValueError(f"{where}: {value!r} is not {kind}")
