"""Read ``rig.toml`` over the defaults, and other settings files; say what is wrong with one."""

import difflib
import hashlib
import json
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from tacauchy_rig.core.config.field_ranges import Section
from tacauchy_rig.core.config.rules import ARM_REQUIRES, broken_rules, required_but_missing
from tacauchy_rig.core.config.settings import RigConfig, RobotModel
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.quantities import UNITS, Dimension, example, split_quantity
from tacauchy_rig.core.registry import Kind, load, unknown

_LINE_MOST = 400
"""Characters of a line, on which a value may be as long as its file."""
_LINES_MOST = 40
"""Of a message: what an operator may mend before looking again."""
_LIMITS = {
    "gt": ("is not above the limit", "write more than"),
    "ge": ("is below the limit", "write at least"),
    "lt": ("is not below the limit", "write less than"),
    "le": ("is above the limit", "write at most"),
}
_KINDS = {
    "int": "is not a whole number",
    "float": "is not a number",
    "bool": "is neither true nor false",
    "string": "is not text; write it in quotes",
    "tuple": 'is not a list; write ["...", "..."]',
    "model": "is not a table",
    "dict": "is not a table",
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


Place = tuple[int | str, ...]
S = TypeVar("S", bound=Section)


def read_section(kind: type[S], tables: Any, *, remedy: str, where: str = "") -> S:
    """Return nested tables as what they are to be.

    Args:
        where: What names in messages begin with: the file, or a table's name and a dot.

    Raises:
        ConfigError: One line for each field that is wrong.
    """
    try:
        return kind.model_validate(tables)
    except ValidationError as error:
        lines = [f"{where}{line}" for line in explain(error, tables, kind)]
        raise ConfigError("\n".join(lines), remedy=remedy) from error


def explain(
    error: ValidationError, tables: Mapping[str, Any], model: type[BaseModel]
) -> Iterator[str]:
    """Yield one line for each wrong field, shortened where it is long beyond reading."""
    found = error.errors()
    wrong = {problem["loc"][:-1] for problem in found}  # a list with a wrong value is not too short
    told = (each for each in found if each["type"] != "too_short" or each["loc"] not in wrong)
    lines = list(dict.fromkeys(_line(problem, tables, model) for problem in told))
    for line in lines[:_LINES_MOST]:
        half = _LINE_MOST // 2
        yield line if len(line) <= _LINE_MOST else f"{line[:half]} ... {line[-half:]}"
    if len(lines) > _LINES_MOST:
        yield f"... and {len(lines) - _LINES_MOST} more"


def _line(problem: Any, tables: Mapping[str, Any], model: type[BaseModel]) -> str:
    location, kind, context = problem["loc"], problem["type"], problem.get("ctx", {})
    name, field = _name(location), _field(model, location)
    written = _written(tables, location, problem["input"])
    if "because" in context and isinstance(written, list):
        name, written = f"{name}[{context['index']}]", written[context["index"]]
    value = json.dumps(written, ensure_ascii=False, default=str)
    if limits := [key for key in _LIMITS if key in context]:
        because = f" ({context['because']})" if "because" in context else ""
        return f"{name}: {value} {_limit(limits[0], context[limits[0]], field, written)}{because}"
    if kind == "extra_forbidden":
        known = _table(model, location).model_fields
        close = difflib.get_close_matches(str(location[-1]), known, n=1)
        meant = f"did you mean {close[0]}?" if close else f"known here: {', '.join(known)}"
        return f"{name}: unknown key; {meant}"
    if kind == "missing":
        return _missing(location, field, tables)
    if kind == "value_error":
        # An arm may be called by its model, such as UR5e.
        called, told = re.sub("[^a-z0-9]", "", str(written).lower()), str(context["error"])
        if location == ("robot", "driver") and called in _ARMS:
            told += f'; write driver = "ur5" and model = "{_ARMS[called]}"'
        shown = "" if value in told or isinstance(written, dict) else f"{value}: "
        return f"{name}: {shown}{told}"
    if kind in ("enum", "literal_error"):
        choices = context["expected"].replace("'", '"').replace(" or ", ", ")
        return f"{name}: {value} is none of {choices}"
    if kind in ("too_long", "too_short"):
        if (needed := _fixed_length(field)) is not None:
            return f"{name}: {_count(needed, written)}"
        allowed = context.get("max_length", context.get("min_length"))
        word = "at most" if kind == "too_long" else "at least"
        return f"{name}: holds {context['actual_length']} values; write {word} {allowed}"
    if kind == "string_pattern_mismatch" and model is RigConfig:
        return f'{name}: {value} may hold only letters, digits, "_", "." and "-"'
    is_kind = not kind.startswith(("string_pattern", "string_too"))
    what = _KINDS.get(kind.split("_")[0] if is_kind else "", problem["msg"])
    if location == ("replay", "tolerance"):
        what = 'has no unit; give "0.02N" or "1%"'
    if tuple(location) in _CAMERA_NUMBERS:
        what = f"{what}; it is the camera's own number, without a unit: `v4l2-ctl -L` lists it"
    return f"{name}: {value} {what}"


def _name(location: Place) -> str:
    named = (part for part in location if part != "[key]")  # pydantic's, of a key that is wrong
    parts = (f"[{part}]" if isinstance(part, int) else f".{part}" for part in named)
    return "".join(parts).removeprefix(".") or "the file"


def _limit(key: str, limit: float, field: FieldInfo | None, written: Any) -> str:
    relation, advice = _LIMITS[key]
    dimension = _dimension(field)
    parts = split_quantity(written) if isinstance(written, str) else None
    if dimension is None or parts is None:
        return f"{relation} {limit:g}; {advice} {limit:g}"
    unit = parts[1]
    text = f"{limit / UNITS[dimension][unit]:.6g} {unit}".strip()
    return f'{relation} {text}; {advice} "{text}"'


def _missing(location: Place, field: FieldInfo | None, tables: Mapping[str, Any]) -> str:
    if isinstance(location[-1], int):
        needed = _fixed_length(field) or location[-1] + 1
        return f"{_name(location[:-1])}: {_count(needed, _written(tables, location[:-1], []))}"
    dimension = _dimension(field)
    advice = f'; write for example {location[-1]} = "{example(dimension)}"' if dimension else ""
    return f"{_name(location)}: missing{advice}"


def _fixed_length(field: FieldInfo | None) -> int | None:
    """Return how many values a list must have; None where that is free."""
    if field is None or get_origin(field.annotation) is not tuple:
        return None
    kinds = get_args(field.annotation)
    return None if Ellipsis in kinds else len(kinds)


def _count(needed: int, written: Any) -> str:
    axes = " (x, y, z)" if needed == len("xyz") else ""
    return f"needs {needed} values{axes}; {len(written)} given"


def _table(model: type[BaseModel], location: Place) -> type[BaseModel]:
    """Return the table that a value lies in."""
    for part in location[:-1]:
        field = model.model_fields.get(str(part))
        kinds = () if field is None else (field.annotation, *get_args(field.annotation))
        inner = (k for k in kinds if isinstance(k, type) and issubclass(k, BaseModel))
        model = next(inner, model)
    return model


def _field(model: type[BaseModel], location: Place) -> FieldInfo | None:
    """Return the field that a value is of, or is an entry of."""
    while location and isinstance(location[-1], int):
        location = location[:-1]
    return _table(model, location).model_fields.get(str(location[-1])) if location else None


def _dimension(field: FieldInfo | None) -> Dimension | None:
    marks = [] if field is None else [*field.metadata, *_metadata(field.annotation)]
    return next((mark for mark in marks if isinstance(mark, Dimension)), None)


def _metadata(annotation: Any) -> Iterator[Any]:
    yield from getattr(annotation, "__metadata__", ())
    for argument in get_args(annotation):
        yield from _metadata(argument)


def _written(tables: Mapping[str, Any], location: Place, value: Any) -> Any:
    found: Any = tables
    for part in location:
        try:
            found = found[part]
        except (KeyError, IndexError, TypeError):
            return value
    return found


BUILT_IN = "built-in default"
# Fields that recorded runs may have and that mean nothing any more.
_GONE = frozenset({"report.ssim", "report.require_discrimination"})


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedConfig:
    """A checked configuration with its history."""

    config: RigConfig
    written: dict[str, Any]  # the merged values as they were written, by dotted field
    sources: dict[str, str]  # where each dotted field came from

    @property
    def config_hash(self) -> str:
        """SHA-256 of the checked values; equal settings have equal hashes."""
        return hash_of_values(self.config.model_dump(mode="json"))


def hash_of_values(values: Any) -> str:
    """Return the SHA-256 of a configuration's values."""
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()


_FILES = resources.files("tacauchy_rig.core.config")


def default_text() -> str:
    """Return the text of the built-in dry-run configuration."""
    return _FILES.joinpath("default.toml").read_text("utf-8")


def example_text() -> str:
    """Return the commented example for a real rig."""
    return _FILES.joinpath("example.toml").read_text("utf-8")


def load_config(path: Path | None = None, *, overrides: Sequence[str] = ()) -> LoadedConfig:
    """Load a configuration.

    Args:
        path: A ``rig.toml``, or None for the dry run's defaults.
        overrides: ``table.field=value`` from the command line.

    Raises:
        ConfigError: Unreadable, unknown key, wrong unit, a limit that cannot hold, or a value of a
            real device that only the built-in defaults give; every problem is listed at once.
    """
    written: dict[str, Any] = {}
    sources: dict[str, str] = {}
    built_in = (BUILT_IN, tomllib.loads(default_text()))
    given = [] if path is None else [(str(path), read_toml(path, remedy=_EXAMPLE))]
    given += [("--set", parse_override(text)) for text in overrides]
    for source, tables in (built_in, *_of_sensor([built_in, *given]), *given):
        values = dict(leaves(tables))
        written |= values
        sources |= dict.fromkeys(values, source)
    defaulted = {field for field, source in sources.items() if source == BUILT_IN}
    config = check_config(nest(written), defaulted=defaulted)
    return LoadedConfig(config=config, written=written, sources=sources)


def _of_sensor(
    layers: Sequence[tuple[str, dict[str, Any]]],
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield what the sensor's file says of its camera, where it says something."""
    named = [tables["sensor"] for _, tables in layers if isinstance(tables.get("sensor"), dict)]
    name = str({key: value for table in named for key, value in table.items()}["name"])
    try:
        file = Path(name) if unknown(Kind.SENSOR, name) else load(Kind.SENSOR, name)
        camera = tomllib.loads(file.read_text("utf-8"))["camera"]
        rate = {"rate": camera["rate"]["value"]} if "rate" in camera else {}
        least = {"min_image_rate": camera["min_rate"]} if "min_rate" in camera else {}
    except (ConfigError, OSError, ValueError, LookupError, TypeError):
        return
    yield f"sensor {name}", {"camera": rate, "protocol": least}


def restore_config(written: Mapping[str, Any]) -> RigConfig:
    """Build the configuration of a recorded run from ``LoadedConfig.written``.

    Fields that this version has and that one had not take their built-in default. What was
    pressed was pressed: neither ceilings nor rules are asked again.

    Raises:
        ConfigError: A field is no longer known, or its value of another kind.
    """
    return check_config(nest(with_defaults(written)))


def with_defaults(written: Mapping[str, Any]) -> dict[str, Any]:
    """Return a recorded run's values as written, by dotted field, over the built-in ones."""
    known = {field: value for field, value in written.items() if field not in _GONE}
    return {**dict(leaves(tomllib.loads(default_text()))), **known}


def check_config(tables: Mapping[str, Any], *, defaulted: Set[str] | None = None) -> RigConfig:
    """Validate nested tables.

    Args:
        tables: The merged values as they were written.
        defaulted: Dotted fields that only the built-in defaults give; None for a recorded run,
            which is read: its drivers need not be installed, and no rule is asked.

    Raises:
        ConfigError: One line for each field that is wrong.
    """
    context = {"recorded": defaulted is None}
    try:
        config = RigConfig.model_validate(tables, context=context)
    except ValidationError as error:
        raise ConfigError("\n".join(explain(error, tables, RigConfig)), remedy=_SHOW) from error
    if defaulted is None:
        return config
    missing = list(required_but_missing(config, defaulted))
    # Rules that tie places together say nothing where some of the places are the dry run's.
    broken = broken_rules(config, placed=not any(rule.field in ARM_REQUIRES for rule in missing))
    problems = [str(rule) for rule in (*missing, *broken)]
    if problems:
        remedy = f"{_EXAMPLE}; {_SHOW}" if missing else _SHOW
        raise ConfigError("\n".join(problems), remedy=remedy)
    return config


_EXAMPLE = "`tacauchy-rig config example` shows each field as it is written"
_SHOW = "`tacauchy-rig config show` lists every field, its value and where it came from"


def read_toml(path: Path, *, remedy: str) -> dict[str, Any]:
    """Read a settings file. ConfigError: It cannot be read, or is no TOML."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}", remedy=remedy) from error
    return parse_toml(data, origin=str(path), remedy=remedy)


def parse_toml(data: bytes, *, origin: str, remedy: str) -> dict[str, Any]:
    """Return the tables of a settings file's bytes; ConfigError: They are no TOML."""
    try:
        return tomllib.loads(data.decode("utf-8"))
    except (ValueError, RecursionError) as error:  # a whole number of 5000 digits, lists in lists
        raise ConfigError(f"{origin}: not valid TOML: {error}", remedy=remedy) from error


def parse_override(text: str) -> dict[str, Any]:
    """Read ``table.field=value``; the value as in TOML, or as text."""
    field, separator, value = text.partition("=")
    if not separator or "." not in field:
        raise ConfigError(
            f"--set {text!r}: expected table.field=value",
            remedy='for example --set camera.width=1280 or --set robot.press_speed="0.2 mm/s"',
        )
    try:
        parsed = tomllib.loads(f"value = {value}")["value"]
    except (ValueError, RecursionError):
        parsed = value
    return nest({field.strip(): parsed})


def leaves(tables: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield each value of nested tables with its dotted name."""
    for key, value in tables.items():
        name = f"{prefix}{key}"
        if isinstance(value, Mapping):
            yield from leaves(value, f"{name}.")
        else:
            yield name, value


def nest(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return nested tables of values by dotted name."""
    tables: dict[str, Any] = {}
    for name, value in values.items():
        *path, last = name.split(".")
        table = tables
        for part in path:
            table = table.setdefault(part, {})
            if not isinstance(table, dict):
                raise ConfigError(
                    f"{name}: unknown key; {'.'.join(path)} is a value, not a table", remedy=_SHOW
                )
        table[last] = value
    return tables


OF_DEVICES = (
    "robot.host",
    "robot.connect_timeout",
    "robot.force_sign",
    "force_sensor.port",
    "force_sensor.connect_timeout",
    "camera.device",
    "camera.connect_timeout",
    "emulation.robot_host",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """A field of a begun run that is another now; values as they are written."""

    field: str
    old: Any
    new: Any

    def __str__(self) -> str:
        return f"{self.field} = {self.new}, before: {self.old}"


def resumed_config(
    written: Mapping[str, Any], overrides: Sequence[str]
) -> tuple[RigConfig, tuple[Change, ...]]:
    """Return the configuration that a run goes on with, and what is changed in it.

    It is pressed with, so ceilings and rules are asked again.

    Args:
        written: What the run was recorded with, by dotted field.
        overrides: ``table.field=value`` from the command line.

    Raises:
        ConfigError: A field that a begun run keeps, or a value that is no longer allowed.
    """
    before = with_defaults(written)
    given = [pair for text in overrides for pair in leaves(parse_override(text))]
    names = [field for field, _ in given if not field.startswith("limits.")]
    if kept := [field for field in names if field not in OF_DEVICES]:
        raise ConfigError(
            "\n".join(
                f"{field}: defines the run; its trials would no longer be one experiment"
                for field in kept
            ),
            remedy="start a new run with it; a begun one takes limits.* and "
            + ", ".join(OF_DEVICES),
        )
    config = check_config(nest({**before, **dict(given)}), defaulted=frozenset())
    changes = (Change(field=name, old=before.get(name), new=value) for name, value in given)
    return config, tuple(change for change in changes if change.old != change.new)
