"""Read ``rig.toml`` over the built-in defaults, check it, and remember where values came from."""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from tacauchy_rig.core.config.explain import explain
from tacauchy_rig.core.config.model import RigConfig
from tacauchy_rig.core.config.rules import ARM_REQUIRES, broken_rules, required_but_missing
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.registry import Kind, load, unknown

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
