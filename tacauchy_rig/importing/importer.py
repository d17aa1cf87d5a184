"""From a source and its ``import.toml`` to a run folder."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from tacauchy_rig.config.devices import IMPORTED
from tacauchy_rig.config.load import (
    LoadedConfig,
    leaves,
    nest,
    parse_override,
    restore_config,
)
from tacauchy_rig.config.model import RigConfig
from tacauchy_rig.errors import ConfigError
from tacauchy_rig.importing.csv_folder import CsvData, read_csv_folder
from tacauchy_rig.importing.press import Recorded
from tacauchy_rig.importing.source import MIB, Source
from tacauchy_rig.importing.spec import PATH_FIELDS, SourceKind, Spec, read_section
from tacauchy_rig.importing.writing import write_run
from tacauchy_rig.registry import Kind, unknown
from tacauchy_rig.store.run_store import RunStore

SPEC_NAME = "import.toml"
SPEC_BYTES = MIB
FIRST_TOUCH = "0.001 mN"
"""A force that no cell tells from none: depth counts from first touch."""
NO_TARGET = "0 N"
"""Nobody of ours asked for a force; a configuration has to name one."""
MESH = "mesh:"
FILE_BYTES = 256 * MIB
"""Of a calibration, a sensor's file or a tool's triangles."""

_TABLES = {SourceKind.CSV: CsvData}


def import_run(
    path: Path,
    *,
    parent: Path,
    overrides: Sequence[str] = (),
    check: Callable[[RigConfig], None] = lambda _: None,
) -> RunStore:
    """Import what a file or a folder with ``import.toml`` describes, as a new run in ``parent``.

    Args:
        path: ``import.toml``, or the folder that holds it.
        parent: Where the run's folder goes.
        overrides: ``table.field=value`` over the file, from the command line.
        check: Refuses a configuration that nothing can be replayed with.

    Raises:
        ConfigError: The description is wrong; every field is named.
        RecordError: A file of the source is missing, odd or too large.
    """
    source = Source(path if path.is_dir() else path.parent)
    name = SPEC_NAME if path.is_dir() else path.name
    text = source.read(name, field="import", most_bytes=SPEC_BYTES)
    overridden = {k: v for each in overrides for k, v in leaves(parse_override(each))}
    spec = _spec(text, name, overridden)
    stated = _stated(source, spec, trusted=overridden)
    recorded, contact_force = _read(source, spec)
    rig = _rig(spec, stated, recorded, contact_force)
    check(rig.config)
    return write_run(
        parent,
        rig,
        recorded,
        kind=spec.kind.value,
        source=source.root.name,
        files=source.hashes,
        config_text=_as_toml(rig.written),
        simulated=spec.simulated,
    )


def _spec(data: bytes, name: str, overridden: Mapping[str, Any]) -> Spec:
    try:
        tables = tomllib.loads(data.decode("utf-8"))
    except (UnicodeDecodeError, ValueError, RecursionError) as error:
        raise ConfigError(f"{name}: not valid TOML: {error}") from error
    values = {**dict(leaves(tables)), **overridden}
    return read_section(Spec, {"data": {}, "rig": {}, **nest(values)})


def _read(source: Source, spec: Spec) -> tuple[Recorded, float | None]:
    """Return what a source holds, and the force at which its depths begin [N]."""
    data = read_section(_TABLES[spec.kind], spec.data, where="data.")
    return read_csv_folder(source, data), data.contact_force


def _stated(source: Source, spec: Spec, *, trusted: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the source says of the rig, its files within the folder.

    Args:
        trusted: Fields of the command line, whose files may lie anywhere.
    """
    stated = dict(leaves(spec.rig))
    for field, value in stated.items():
        if f"rig.{field}" in trusted or not isinstance(value, str):
            continue
        if field == "sensor.name" and not unknown(Kind.SENSOR, value):
            continue
        if field in PATH_FIELDS and value:
            stated[field] = str(source.path(value, field=f"rig.{field}", most_bytes=FILE_BYTES))
        elif field == "replay.indenter":
            stated[field] = mesh_within(source, value, field=f"rig.{field}")
    return stated


def mesh_within(source: Source, term: str, *, field: str) -> str:
    """Return an indenter's term; the file of one of triangles has to lie in the folder."""
    if not term.startswith(MESH):
        return term
    name, comma, rest = term.removeprefix(MESH).partition(",")
    path = source.path(name, field=field, most_bytes=FILE_BYTES)
    return f"{MESH}{path}{comma}{rest}"


def _rig(
    spec: Spec, stated: Mapping[str, Any], recorded: Recorded, contact_force_n: float | None
) -> LoadedConfig:
    """Return the run's configuration: what the source says, over the built-in replay and report."""
    force = FIRST_TOUCH if contact_force_n is None else f"{contact_force_n:.9g} N"
    ours = {
        "run.name": spec.name,
        "run.sync_mode": recorded.sync_mode,
        **{f"{device}.driver": IMPORTED for device in ("robot", "force_sensor", "camera")},
        "protocol.force_targets": [NO_TARGET],
        "protocol.contact_force": force,
    }
    written = {**stated, **ours}
    return LoadedConfig(
        config=restore_config(written),
        written=written,
        sources={**dict.fromkeys(stated, SPEC_NAME), **dict.fromkeys(ours, "import")},
    )


def _as_toml(written: Mapping[str, Any]) -> str:
    """Return dotted fields as TOML; JSON writes text, numbers and lists alike."""
    lines = (f"{field} = {json.dumps(value)}" for field, value in written.items())
    return "\n".join(["# What was imported says of itself.", *lines, ""])
