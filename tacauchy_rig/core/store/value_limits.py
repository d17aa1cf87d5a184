"""What the numbers of a run's files can be: finite, of a size that their unit allows, in order.

A file may come from somebody else, or have been edited. What reads it later divides by these
numbers, squares them and cuts recordings at them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from types import NoneType
from typing import Any, TypeVar, get_args

from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import FREE
from tacauchy_rig.core.store.codec import from_json, types_of_fields

T = TypeVar("T")

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
_REMEDY = "the file was edited or damaged: take it from a copy of the run, or press the trial again"


def read_value(kind: type[T], data: Any, *, source: str) -> T:
    """Build ``kind`` as ``from_json`` does, of numbers that can be.

    An infinite number is none, nor is NaN where None could say that nothing is known. A window
    does not end before it starts.

    Raises:
        RecordError: Names source, field and value.
    """
    found = from_json(kind, data, source=source)
    _check(found, source, "", "", is_optional=False)
    return found


def _check(value: Any, source: str, place: str, name: str, *, is_optional: bool) -> None:
    if is_dataclass(value):
        _check_fields(value, source, place)
    elif isinstance(value, Mapping):
        for key, item in value.items():
            _check(item, source, f"{place}.{key}", str(key), is_optional=is_optional)
    elif isinstance(value, tuple | list):
        for index, item in enumerate(value):
            _check(item, source, f"{place}[{index}]", name, is_optional=is_optional)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        _check_number(value, source, place, name, is_optional=is_optional)


def _check_fields(value: Any, source: str, place: str) -> None:
    kind: Any = type(value)
    hints = types_of_fields(kind)
    for field in fields(value):
        if field.metadata.get(FREE):
            continue
        where = f"{place}.{field.name}" if place else field.name
        is_optional = NoneType in get_args(hints[field.name])
        found = getattr(value, field.name)
        _check(found, source, where, field.name, is_optional=is_optional)
        if field.name.endswith(_END):
            start = getattr(value, field.name.removesuffix(_END) + _START)
            if None not in (start, found) and found < start:
                raise _refused(source, where, found, f"lies before its start, {start}")


def _check_number(value: float, source: str, place: str, name: str, *, is_optional: bool) -> None:
    unit, before = [*reversed(name.split("_")), ""][:2]
    low, high = _ANY_UNIT if before in _NUMERATORS else _LIMITS.get(unit, _ANY_UNIT)
    if math.isinf(value) or (math.isnan(value) and is_optional):
        raise _refused(source, place, value, "is no number that can be measured")
    if value < low or value > high:
        raise _refused(source, place, value, f"cannot be: {low:g} to {high:g} can")


def _refused(source: str, place: str, value: float, why: str) -> RecordError:
    return RecordError(f"{source}: {place or 'the whole of it'}: {value} {why}", remedy=_REMEDY)
