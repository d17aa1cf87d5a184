"""Say what is wrong with a field in the words and units of the file it stands in."""

from __future__ import annotations

import difflib
import json
import re
from collections.abc import Iterator, Mapping
from typing import Any, get_args, get_origin

from pydantic import ValidationError
from pydantic.fields import FieldInfo

from tacauchy_rig.core.config.model import RigConfig, RobotModel
from tacauchy_rig.core.quantities import UNITS, Dimension, example, split_quantity

_LINE_MOST = 400
"""Characters of a line, on which a value may be as long as its file."""
_LINES_MOST = 40
"""Of a message: what an operator may mend before looking again."""
_LIMITS = {
    "greater_than": ("gt", "is not above the limit", "write more than"),
    "greater_than_equal": ("ge", "is below the limit", "write at least"),
    "less_than": ("lt", "is not below the limit", "write less than"),
    "less_than_equal": ("le", "is above the limit", "write at most"),
}
_KINDS = {
    "int": "is not a whole number",
    "float": "is not a number",
    "bool": "is neither true nor false",
    "string": "is not text; write it in quotes",
    "tuple": 'is not a list; write ["...", "..."]',
    "model": "is not a table",
    "finite": "is not a finite number",
}
_CAMERA_NUMBERS = {("camera", name) for name in ("exposure", "gain", "white_balance")}
_ARMS = {
    "ur5e": RobotModel.E_SERIES,
    "ur5eseries": RobotModel.E_SERIES,
    "eseries": RobotModel.E_SERIES,
    "ur5cb3": RobotModel.CB3,
    "cb3": RobotModel.CB3,
}


def explain(error: ValidationError, tables: Mapping[str, Any]) -> Iterator[str]:
    """Yield one line for each wrong field, shortened where it is long beyond reading.

    Args:
        error: What pydantic found.
        tables: The values as they were written.
    """
    lines = list(dict.fromkeys(_line(problem, tables) for problem in error.errors()))
    for line in lines[:_LINES_MOST]:
        half = _LINE_MOST // 2
        yield line if len(line) <= _LINE_MOST else f"{line[:half]} ... {line[-half:]}"
    if len(lines) > _LINES_MOST:
        yield f"... and {len(lines) - _LINES_MOST} more"


def _line(problem: Any, tables: Mapping[str, Any]) -> str:
    location, kind = problem["loc"], problem["type"]
    name = _name(location)
    written = _written(tables, location, problem["input"])
    value = json.dumps(written, ensure_ascii=False, default=str)
    if kind in _LIMITS:
        key = _LIMITS[kind][0]
        return f"{name}: {value} {_limit(key, problem['ctx'][key], location, written)}"
    if kind == "ceiling":
        return _above_ceiling(problem["ctx"], location, written)
    if kind == "extra_forbidden":
        return f"{name}: unknown key; {_suggestion(location)}"
    if kind == "missing":
        return _missing(location, tables)
    if kind == "value_error":
        return f"{name}: {problem['ctx']['error']}{_arm_advice(location, written)}"
    if kind == "enum":
        choices = problem["ctx"]["expected"].replace("'", '"').replace(" or ", ", ")
        return f"{name}: {value} is none of {choices}"
    if kind in ("too_long", "too_short"):
        context = problem["ctx"]
        if (needed := _fixed_length(location)) is not None:
            return f"{name}: {_count(needed, written)}"
        allowed = context.get("max_length", context.get("min_length"))
        word = "at most" if kind == "too_long" else "at least"
        return f"{name}: holds {context['actual_length']} values; write {word} {allowed}"
    if kind == "string_pattern_mismatch":
        return f'{name}: {value} may hold only letters, digits, "_", "." and "-"'
    what = _KINDS.get(kind.split("_")[0], problem["msg"])
    if location == ("replay", "tolerance"):
        what = 'has no unit; give "0.02N" or "1%"'
    if tuple(location) in _CAMERA_NUMBERS:
        what = f"{what}; it is the camera's own number, without a unit: `v4l2-ctl -L` lists it"
    return f"{name}: {value} {what}"


def _name(location: tuple[int | str, ...]) -> str:
    parts = (f"[{part}]" if isinstance(part, int) else f".{part}" for part in location)
    return "".join(parts).removeprefix(".") or "rig.toml"


def _above_ceiling(context: Any, location: tuple[int | str, ...], written: Any) -> str:
    name = _name(location)
    if isinstance(written, list):
        name, written = f"{name}[{context['index']}]", written[context["index"]]
    key = "le" if "le" in context else "ge"
    limit = _limit(key, context[key], location, written)
    value = json.dumps(written, ensure_ascii=False, default=str)
    return f"{name}: {value} {limit} ({context['because']})"


def _limit(key: str, limit: float, location: tuple[int | str, ...], written: Any) -> str:
    relation, advice = next((r, a) for k, r, a in _LIMITS.values() if k == key)
    dimension = _dimension(location)
    parts = split_quantity(written) if isinstance(written, str) else None
    if dimension is None or parts is None:
        return f"{relation} {limit:g}; {advice} {limit:g}"
    unit = parts[1]
    text = f"{limit / UNITS[dimension][unit]:.6g} {unit}".strip()
    return f'{relation} {text}; {advice} "{text}"'


def _missing(location: tuple[int | str, ...], tables: Mapping[str, Any]) -> str:
    if isinstance(location[-1], int):
        needed = _fixed_length(location[:-1]) or location[-1] + 1
        return f"{_name(location[:-1])}: {_count(needed, _written(tables, location[:-1], []))}"
    dimension = _dimension(location)
    advice = f'; write for example {location[-1]} = "{example(dimension)}"' if dimension else ""
    return f"{_name(location)}: missing{advice}"


def _fixed_length(location: tuple[int | str, ...]) -> int | None:
    """Return how many values a list must have; None where that is free."""
    field = _field(location)
    if field is None or get_origin(field.annotation) is not tuple:
        return None
    kinds = get_args(field.annotation)
    return None if Ellipsis in kinds else len(kinds)


def _count(needed: int, written: Any) -> str:
    axes = " (x, y, z)" if needed == len("xyz") else ""
    return f"needs {needed} values{axes}; {len(written)} given"


def _arm_advice(location: tuple[int | str, ...], written: Any) -> str:
    """Return what to write for an arm called by its model, such as UR5e."""
    called = re.sub("[^a-z0-9]", "", str(written).lower())
    if location != ("robot", "driver") or called not in _ARMS:
        return ""
    return f'; write driver = "ur5" and model = "{_ARMS[called]}"'


def _suggestion(location: tuple[int | str, ...]) -> str:
    known = _fields(location)
    close = difflib.get_close_matches(str(location[-1]), known, n=1)
    return f"did you mean {close[0]}?" if close else f"known here: {', '.join(known)}"


def _fields(location: tuple[int | str, ...]) -> dict[str, FieldInfo]:
    """Return the fields of the table that a value lies in."""
    if len(location) == 1:
        return RigConfig.model_fields
    section: Any = RigConfig.model_fields[str(location[0])].annotation
    return dict(section.model_fields)


def _field(location: tuple[int | str, ...]) -> FieldInfo | None:
    return _fields(location).get(str(location[1])) if len(location) > 1 else None


def _dimension(location: tuple[int | str, ...]) -> Dimension | None:
    field = _field(location)
    marks = [] if field is None else [*field.metadata, *_metadata(field.annotation)]
    return next((mark for mark in marks if isinstance(mark, Dimension)), None)


def _metadata(annotation: Any) -> Iterator[Any]:
    yield from getattr(annotation, "__metadata__", ())
    for argument in get_args(annotation):
        yield from _metadata(argument)


def _written(tables: Mapping[str, Any], location: tuple[int | str, ...], value: Any) -> Any:
    found: Any = tables
    for part in location:
        try:
            found = found[part]
        except (KeyError, IndexError, TypeError):
            return value
    return found
