"""Read ``rig.toml`` over the defaults, check it, and say what is wrong in the file's own words."""

import difflib
import hashlib
import json
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, get_args, get_origin

from pydantic import ValidationError
from pydantic.fields import FieldInfo

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
    "greater_than": ("gt", "is not above the limit", "write more than"),
    "greater_than_equal": ("ge", "is below the limit", "write at least"),
    "less_than": ("lt", "is not below the limit", "write less than"),
    "less_than_equal": ("le", "is above the limit", "write at most"),
}
_KINDS = {
    "int": "is not a whole number",
    "literal": "is neither 1 nor -1",
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
    """Yield one line for each wrong field, shortened where it is long beyond reading."""
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
        known = _fields(location)
        close = difflib.get_close_matches(str(location[-1]), known, n=1)
        meant = f"did you mean {close[0]}?" if close else f"known here: {', '.join(known)}"
        return f"{name}: unknown key; {meant}"
    if kind == "missing":
        return _missing(location, tables)
    if kind == "value_error":
        # An arm may be called by its model, such as UR5e.
        called, advice = re.sub("[^a-z0-9]", "", str(written).lower()), ""
        if location == ("robot", "driver") and called in _ARMS:
            advice = f'; write driver = "ur5" and model = "{_ARMS[called]}"'
        return f"{name}: {problem['ctx']['error']}{advice}"
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
    given = [] if path is None else [(str(path), _read_toml(path))]
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
        raise ConfigError("\n".join(explain(error, tables)), remedy=_SHOW) from error
    if defaulted is None:
        return config
    missing = list(required_but_missing(config, defaulted))
    # Rules that tie places together say nothing where some of the places are the dry run's.
    broken = broken_rules(config, placed=not any(name in ARM_REQUIRES for name, *_ in missing))
    problems = [f"{name}: {what}; {remedy}" for name, what, remedy in (*missing, *broken)]
    if problems:
        remedy = f"{_EXAMPLE}; {_SHOW}" if missing else _SHOW
        raise ConfigError("\n".join(problems), remedy=remedy)
    return config


_EXAMPLE = "`tacauchy-rig config example` shows each as it is written"
_SHOW = "`tacauchy-rig config show` lists every field, its value and where it came from"


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text("utf-8"))
    except FileNotFoundError as error:
        raise ConfigError(
            f"{path}: no such configuration file",
            remedy="`tacauchy-rig config example > rig.toml` writes a commented one",
        ) from error
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from error
    except (ValueError, RecursionError) as error:  # a whole number of 5000 digits, lists in lists
        raise ConfigError(f"{path}: not valid TOML: {error}") from error


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
