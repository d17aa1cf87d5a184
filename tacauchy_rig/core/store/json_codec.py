"""Plain dataclasses to JSON and back, refusing what does not fit and numbers that cannot be.

A file may come from somebody else, or have been edited. What reads it later divides by its
numbers, squares them and cuts recordings at them: ``read_value`` asks them to be finite, of a size
that their unit allows, and in order.

JSON knows no infinities and no NaN. What is read again has them as the text ``"Infinity"``,
``"-Infinity"`` and ``"NaN"`` (``to_json``); what others read, reports and ``--json``, has null
(``to_plain``).
"""

import json
import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from types import NoneType
from typing import Any, TypeVar, get_args, get_type_hints

import numpy as np
import pydantic_core
from pydantic import TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.quantities import FREE
from tacauchy_rig.core.store.run_files import read_bytes

T = TypeVar("T")

_types_of_fields = cache(get_type_hints)

_NON_FINITE = {"NaN": math.nan, "Infinity": math.inf, "-Infinity": -math.inf}
_MAX_NESTING = 64
_MAX_INTEGER = 2**1023
"""The largest that a float can still hold, roughly."""
_SHOWN = 120
"""Characters of a value or a name in a message; a file may hold millions."""
_REMEDY = "the file was edited, or written by another version of this program"


def to_json(value: object) -> Any:
    """Return ``value`` as dictionaries, lists, text and numbers that ``from_json`` takes back."""
    return _plain(value, json.dumps)


def to_plain(value: object) -> Any:
    """Return ``value`` as dictionaries, lists, text and numbers; numbers that are none are null."""
    return _plain(value, lambda _: None)


def _plain(value: object, non_finite: Callable[[float], str | None]) -> Any:
    def other(part: Any) -> Any:
        if isinstance(part, np.generic | np.ndarray):
            return part.tolist()
        if isinstance(part, Mapping):
            return dict(part)
        raise TypeError(f"{type(part).__name__} has no JSON form")

    def finite(part: Any) -> Any:
        if isinstance(part, dict):
            return {key: finite(each) for key, each in part.items()}
        if isinstance(part, list):
            return [finite(each) for each in part]
        is_none = isinstance(part, float) and not math.isfinite(part)
        return non_finite(part) if is_none else part

    try:
        kept: Any = pydantic_core.to_jsonable_python(
            value, inf_nan_mode="constants", fallback=other
        )
        return finite(kept)
    except (pydantic_core.PydanticSerializationError, TypeError) as error:
        raise RecordError(
            f"a {type(value).__name__} cannot be written as JSON: {error}",
            remedy="this is a defect of the program: please report it",
        ) from error


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
        found = json.loads(data, object_pairs_hook=_once)
        _check_bounds(found)
    except (ValueError, RecursionError) as error:
        raise RecordError(f"{source}: not valid JSON: {error}", remedy=_REMEDY) from error
    return found


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return an object whose keys stand in it once: of two values a reader would take either."""
    found = dict(pairs)
    if len(found) < len(pairs):
        key, count = Counter(name for name, _ in pairs).most_common(1)[0]
        raise ValueError(f"{_shown(key)} stands {count} times in one object")
    return found


def _shown(value: object) -> str:
    """Return a value of a file as a terminal can print it, cut where it is long."""
    text = ascii(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}... ({len(text)} characters)"


def _check_bounds(found: Any) -> None:
    """Raise ValueError of what would break a reader later."""
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


def read_json(kind: type[T], path: Path, *, what: str) -> T:
    """Read a JSON file as a kind of value.

    Raises:
        RecordError: It is missing or damaged, or holds what cannot be; names file and field.
    """
    return read_value(kind, loads(read_bytes(path, what=what), source=str(path)), source=str(path))


def read_value(kind: type[T], data: Any, *, source: str) -> T:
    """Build ``kind`` as ``from_json`` does, of numbers that can be.

    An infinite number is none, nor is NaN where None could say that nothing is known, or in a list
    of any length. A window does not end before it starts.

    Raises:
        RecordError: Names source, field and value.
    """
    found = from_json(kind, data, source=source)
    if problem := next(_problems(found, "", "", is_optional=False), ""):
        raise RecordError(
            f"{source}: {problem}",
            remedy="the file was edited or damaged: take it from a copy of the run, or press the "
            "trial again",
        )
    return found


def from_json(kind: type[T], data: Any, *, source: str = "record") -> T:
    """Build ``kind`` from what ``to_json`` gave.

    Args:
        kind: A dataclass, or any type its fields may have.
        source: Name of the file (and line), for messages.

    Raises:
        RecordError: A field is unknown, missing, or of another type; the message names it.
    """
    text = json.dumps(data)
    try:
        return _validated(kind, text)
    except ValidationError as error:
        # An unknown field first: it may be a missing one that is written wrong.
        problems = sorted(error.errors(), key=lambda each: each["type"] != _UNKNOWN)
    known: Any = json.loads(text)
    for each in problems:
        number = _NON_FINITE.get(str(each["input"]))
        if each["type"] != "float_type" or number is None:
            raise _unfit(each, source)
        place, (*path, last) = known, each["loc"]
        for part in path:
            place = place[part]
        place[last] = number
    try:
        return _validated(kind, json.dumps(known))
    except ValidationError as error:
        raise _unfit(error.errors()[0], source) from error


_UNKNOWN = "unexpected_keyword_argument"


def _validated(kind: type[T], text: str) -> T:
    wanted: Any = kind
    found: T = _adapter(wanted).validate_json(text, strict=True, extra="forbid")
    return found


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


def _unfit(problem: ErrorDetails, source: str) -> RecordError:
    parts = (f"[{each}]" if isinstance(each, int) else _member(each) for each in problem["loc"])
    name = "".join(parts).removeprefix(".") or "the whole of it"
    whats = {_UNKNOWN: "unknown field", "missing": "missing field"}
    message = whats.get(problem["type"]) or f"{_shown(problem['input'])}: {problem['msg']}"
    return RecordError(f"{source}: {name}: {message}", remedy=_REMEDY)


def _member(key: object) -> str:
    """Return how a message names a field or a key."""
    return f".{_shown(key).removeprefix(chr(39)).removesuffix(chr(39))}"


_LIMITS = {
    "n": (-1e6, 1e6),
    "nm": (-1e6, 1e6),
    "m": (-1e3, 1e3),
    "s": (-1e12, 1e12),
    "ms": (-1e12, 1e12),
    "hz": (0.0, 1e9),
    "pa": (-1e15, 1e15),
    "kg": (0.0, 1e6),
    "rad": (-1e3, 1e3),
    "count": (-1e15, 1e15),
    "ns": (0, 2**62),
    "index": (0, 10**6),
    "attempt": (0, 10**6),
    "trial": (0, 10**6),
}
"""By the last word of a field's name: its unit, or what it counts."""
# Before the last word these make it a quotient, as in ``scale_px_m`` and ``stiffness_n_m``.
_NUMERATORS = {"px", "levels", "kg", "m", "n", "nm", "pa", "rad"}
_ANY_UNIT = (-1e100, 1e100)  # the square of which is still a number
_START, _END = "start_ns", "end_ns"


def _problems(value: Any, place: str, name: str, *, is_optional: bool) -> Iterator[str]:
    """Yield the place of each number that cannot be, the number, and why."""
    if is_dataclass(value):
        yield from _problems_of_fields(value, place)
    elif isinstance(value, Mapping):
        for key, item in value.items():
            where = f"{place}{_member(key)}"
            yield from _problems(item, where, str(key), is_optional=is_optional)
    elif isinstance(value, tuple | list):
        for index, item in enumerate(value):
            yield from _problems(item, f"{place}[{index}]", name, is_optional=is_optional)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        unit, before = [*reversed(name.split("_")), ""][:2]
        low, high = _ANY_UNIT if before in _NUMERATORS else _LIMITS.get(unit, _ANY_UNIT)
        where = place or "the whole of it"
        if math.isinf(value) or (math.isnan(value) and is_optional):
            yield f"{where}: {value} is no number that can be measured"
        elif value < low or value > high:
            yield f"{where}: {value} cannot be: {low:g} to {high:g} can"


def _problems_of_fields(value: Any, place: str) -> Iterator[str]:
    kind: Any = type(value)
    hints = _types_of_fields(kind)
    for field in fields(value):
        if field.metadata.get(FREE):
            continue
        where = f"{place}.{field.name}" if place else field.name
        # Of a list of any length what is not known is left out.
        is_optional = not {NoneType, Ellipsis}.isdisjoint(get_args(hints[field.name]))
        found = getattr(value, field.name)
        yield from _problems(found, where, field.name, is_optional=is_optional)
        if field.name.endswith(_END):
            start = getattr(value, field.name.removesuffix(_END) + _START)
            if None not in (start, found) and found < start:
                yield f"{where}: {found} lies before its start, {start}"
