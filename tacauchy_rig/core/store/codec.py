"""Plain dataclasses to JSON and back, refusing what does not fit.

JSON knows no infinities and no NaN. What is read again has them as the text ``"Infinity"``,
``"-Infinity"`` and ``"NaN"`` (``to_json``); what others read, reports and ``--json``, has null
(``to_plain``).
"""

from __future__ import annotations

import json
import math
import types
from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from enum import Enum
from functools import cache
from typing import Any, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import numpy as np
import pydantic_core

from tacauchy_rig.core.errors import RecordError

T = TypeVar("T")

types_of_fields = cache(get_type_hints)

_NON_FINITE = {"NaN": math.nan, "Infinity": math.inf, "-Infinity": -math.inf}
_MAX_NESTING = 64
_MAX_INTEGER = 2**1023
"""The largest that a float can still hold, roughly."""
_REMEDY = "the file was edited, or written by another version of this program"


def to_json(value: object) -> Any:
    """Return ``value`` as dictionaries, lists, text and numbers that ``from_json`` takes back.

    Raises:
        RecordError: It holds something that JSON cannot hold.
    """
    return _without_non_finite(_plain(value), keep_as_text=True)


def to_plain(value: object) -> Any:
    """Return ``value`` as dictionaries, lists, text and numbers; numbers that are none are null.

    Raises:
        RecordError: It holds something that JSON cannot hold.
    """
    return _without_non_finite(_plain(value), keep_as_text=False)


def _plain(value: object) -> Any:
    try:
        return pydantic_core.to_jsonable_python(
            value, inf_nan_mode="constants", fallback=_arrays_and_mappings
        )
    except (pydantic_core.PydanticSerializationError, TypeError) as error:
        raise RecordError(
            f"a {type(value).__name__} cannot be written as JSON: {error}",
            remedy="this is a defect of the program: please report it",
        ) from error


def _without_non_finite(plain: Any, *, keep_as_text: bool) -> Any:
    if isinstance(plain, dict):
        return {k: _without_non_finite(v, keep_as_text=keep_as_text) for k, v in plain.items()}
    if isinstance(plain, list):
        return [_without_non_finite(item, keep_as_text=keep_as_text) for item in plain]
    if isinstance(plain, float) and not math.isfinite(plain):
        return json.dumps(plain) if keep_as_text else None
    return plain


def _arrays_and_mappings(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"{type(value).__name__} has no JSON form")


def from_json(kind: type[T], data: Any, *, source: str = "record") -> T:
    """Build ``kind`` from what ``to_json`` gave.

    Args:
        kind: A dataclass, or any type its fields may have.
        data: Parsed JSON.
        source: Name of the file (and line), for messages.

    Raises:
        RecordError: A field is unknown, missing, or of another type; the message names it.
    """
    return cast("T", _build(kind, data, source, ""))


def dumps(value: object, *, indent: int | None = 2) -> bytes:
    """Return ``value`` as JSON text in UTF-8, ending in a newline."""
    text = json.dumps(to_json(value), indent=indent, ensure_ascii=False, allow_nan=False)
    return f"{text}\n".encode()


def loads(data: bytes, *, source: str) -> Any:
    """Parse JSON text of no more nesting, numbers and text than the program writes.

    Raises:
        RecordError: It is no such JSON; the message names ``source`` and the place.
    """
    try:
        found = json.loads(data)
        _check_bounds(found)
    except (ValueError, RecursionError) as error:
        raise RecordError(f"{source}: not valid JSON: {error}", remedy=_REMEDY) from error
    return found


def _check_bounds(found: Any) -> None:
    """Refuse what would break a reader later.

    Raises:
        ValueError: Names it.
    """
    waiting = [(found, 0)]
    while waiting:
        value, depth = waiting.pop()
        if depth > _MAX_NESTING:
            raise ValueError(f"it is nested more than {_MAX_NESTING} deep")
        if isinstance(value, dict):
            waiting += [(each, depth + 1) for each in value]
            value = list(value.values())
        if isinstance(value, list):
            waiting += [(each, depth + 1) for each in value]
        elif isinstance(value, str):
            value.encode()  # half a surrogate pair can be neither printed nor written
        elif isinstance(value, int) and abs(value) > _MAX_INTEGER:
            raise ValueError(f"a whole number has more than {_MAX_INTEGER.bit_length()} bits")


def _build(kind: Any, data: Any, source: str, field: str) -> Any:
    origin, arguments = get_origin(kind), get_args(kind)
    if kind is Any:
        return data
    if origin in (Union, types.UnionType):
        return _build_union(arguments, data, source, field)
    if origin is tuple:
        return _build_tuple(arguments, data, source, field)
    if origin is dict:
        _require(isinstance(data, dict), "a table", data, source, field)
        return {
            key: _build(arguments[1], item, source, f"{field}.{key}") for key, item in data.items()
        }
    if is_dataclass(kind):
        return _build_dataclass(kind, data, source, field)
    return _build_scalar(kind, data, source, field)


def _build_dataclass(kind: Any, data: Any, source: str, field: str) -> Any:
    _require(isinstance(data, dict), f"a table ({kind.__name__})", data, source, field)
    hints = types_of_fields(kind)
    known = {item.name: item for item in fields(kind)}
    prefix = f"{field}." if field else ""
    for name in data:
        if name not in known:
            raise RecordError(f"{source}: {prefix}{name}: unknown field", remedy=_REMEDY)
    for name, item in known.items():
        if name not in data and item.default is MISSING and item.default_factory is MISSING:
            raise RecordError(f"{source}: {prefix}{name}: missing field", remedy=_REMEDY)
    return kind(
        **{name: _build(hints[name], data[name], source, f"{prefix}{name}") for name in data}
    )


def _build_union(arguments: tuple[Any, ...], data: Any, source: str, field: str) -> Any:
    if data is None and type(None) in arguments:
        return None
    (kind,) = (item for item in arguments if item is not type(None))
    return _build(kind, data, source, field)


def _build_tuple(arguments: tuple[Any, ...], data: Any, source: str, field: str) -> Any:
    _require(isinstance(data, list | tuple), "a list", data, source, field)
    if len(arguments) == 2 and arguments[1] is Ellipsis:
        arguments = (arguments[0],) * len(data)
    _require(len(data) == len(arguments), f"{len(arguments)} values", data, source, field)
    pairs = enumerate(zip(arguments, data, strict=True))
    return tuple(_build(kind, item, source, f"{field}[{index}]") for index, (kind, item) in pairs)


def _build_scalar(kind: Any, data: Any, source: str, field: str) -> Any:
    if kind is float:
        if isinstance(data, str) and data in _NON_FINITE:
            return _NON_FINITE[data]
        number = isinstance(data, int | float) and not isinstance(data, bool)
        _require(number, "a number", data, source, field)
        return float(data)
    if isinstance(kind, type) and issubclass(kind, Enum):
        values = [item.value for item in kind]
        _require(data in values, "one of " + ", ".join(map(str, values)), data, source, field)
        return kind(data)
    if kind is int:
        whole = isinstance(data, int) and not isinstance(data, bool)
        _require(whole, "a whole number", data, source, field)
        return data
    _require(isinstance(data, kind), f"a {kind.__name__}", data, source, field)
    return data


def _require(fits: bool, wanted: str, data: Any, source: str, field: str) -> None:
    if not fits:
        name = field or "the whole of it"
        raise RecordError(f"{source}: {name}: {data!r} is not {wanted}", remedy=_REMEDY)
