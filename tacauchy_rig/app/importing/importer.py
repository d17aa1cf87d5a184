"""From a source and its ``import.toml`` to a run folder."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field, field_validator

from tacauchy_rig.app.importing.bag import BagData, read_bag
from tacauchy_rig.app.importing.lerobot import LeRobotData, read_lerobot
from tacauchy_rig.app.importing.presses import Recorded
from tacauchy_rig.app.importing.records import RecordsData, read_records
from tacauchy_rig.app.importing.source import MIB, Source
from tacauchy_rig.app.importing.table import CsvData, read_csv_folder, read_section
from tacauchy_rig.app.importing.taxim import TaximData, read_taxim
from tacauchy_rig.app.importing.video import VideoData, read_video
from tacauchy_rig.app.importing.writing import write_run
from tacauchy_rig.core.config.fields import Section
from tacauchy_rig.core.config.load import LoadedConfig, leaves, nest, parse_override, restore_config
from tacauchy_rig.core.config.model import IMPORTED, RigConfig
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.imported import SAME_PLACE_M
from tacauchy_rig.core.registry import Kind, unknown
from tacauchy_rig.core.store.run_store import RunStore

RIG_TABLES = ("sensor", "replay", "report", "uncertainty")
RIG_FIELDS = ("force_sensor.to_tip", "force_sensor.compression_sign", "robot.tool_rotation")
"""What of ``rig.toml`` a source may say: the rest is of devices that it does not have."""
PATH_FIELDS = ("sensor.name", "sensor.optics_calibration")
"""Of these, names that may be files: they are looked for in the folder."""


class SourceKind(StrEnum):
    """Formats that can be imported."""

    CSV = "csv"
    BAG = "bag"
    TAXIM = "taxim"
    VIDEO = "video"
    RECORDS = "records"
    LEROBOT = "lerobot"


class Spec(Section):
    """All of ``import.toml``.

    Attributes:
        name: Of the run; what the format suggests, if left out.
        simulated: The presses are of a simulator or an emulator.
        data: Of the source; its kind says what may stand there.
        rig: What the run's ``rig.toml`` is to say of sensor, replay and report.
    """

    kind: SourceKind
    name: str | None = Field(default=None, pattern=r"^[A-Za-z0-9_.-]{1,60}$")
    simulated: bool = False
    data: dict[str, Any]
    rig: dict[str, Any]

    @field_validator("rig")
    @classmethod
    def _is_of_the_replay(cls, tables: dict[str, Any]) -> dict[str, Any]:
        for name, _ in leaves(tables):
            if name.partition(".")[0] not in RIG_TABLES and name not in RIG_FIELDS:
                known = ", ".join((*(f"rig.{table}" for table in RIG_TABLES), *RIG_FIELDS))
                raise ValueError(f'"{name}" says nothing of an imported run; it may say: {known}')
        return tables


SPEC_NAME = "import.toml"
SPEC_BYTES = MIB
FIRST_TOUCH = "0.001 mN"
"""Below the resolution of any cell: depth counts from first touch."""
NO_TARGET = "0 N"
"""An import has no target force; a configuration has to name one."""
MESH = "mesh:"
FILE_BYTES = 256 * MIB
"""Of a calibration, a sensor's file or a tool's triangles."""

BARE = {
    ".whl": SourceKind.TAXIM,
    ".npz": SourceKind.TAXIM,
    ".mcap": SourceKind.BAG,
    ".db3": SourceKind.BAG,
}
"""Files that can be imported without an ``import.toml``."""
FILE = "data.file"


READERS: Mapping[SourceKind, tuple[type[Section], Callable[[Source, Any], Recorded]]] = {
    SourceKind.CSV: (CsvData, read_csv_folder),
    SourceKind.BAG: (BagData, read_bag),
    SourceKind.TAXIM: (TaximData, read_taxim),
    SourceKind.VIDEO: (VideoData, read_video),
    SourceKind.RECORDS: (RecordsData, read_records),
    SourceKind.LEROBOT: (LeRobotData, read_lerobot),
}
"""Of each format its ``[data]``, and what reads it."""


def import_run(
    path: Path,
    *,
    parent: Path,
    overrides: Sequence[str] = (),
    check: Callable[[RigConfig], None] = lambda _: None,
) -> RunStore:
    """Import what a file or a folder with ``import.toml`` describes, as a new run in ``parent``.

    Args:
        path: ``import.toml``, the folder that holds it, or one of ``BARE``.
        parent: Where the run's folder goes.
        overrides: ``table.field=value`` over the file, from the command line.
        check: Refuses a configuration that nothing can be replayed with.

    Raises:
        ConfigError: The description is wrong; every field is named.
        RecordError: A file of the source is missing, odd or too large.
    """
    source = Source(path if path.is_dir() else path.parent)
    overridden = {k: v for each in overrides for k, v in leaves(parse_override(each))}
    spec = _spec(source, path, overridden)
    stated = _stated(source, spec, trusted=overridden)
    kind, read = READERS[spec.kind]
    recorded = _with_tools(source, read(source, read_section(kind, spec.data, where="data.")))
    rig = _rig(spec, {**_common(recorded), **stated}, recorded)
    check(rig.config)
    for term in {each.indenter for each in recorded.presses} - {""}:
        check(restore_config({**rig.written, "replay.indenter": term}))
    return write_run(
        parent,
        rig,
        recorded,
        kind=spec.kind.value,
        source=source.root.name if path.is_dir() else path.name,
        files=source.hashes,
        config_text=_as_toml(rig.written),
        simulated=spec.simulated,
    )


def _spec(source: Source, path: Path, overridden: Mapping[str, Any]) -> Spec:
    """Return the description, and over it what the command line says."""
    if not path.is_dir() and (kind := BARE.get(path.suffix)):
        described = {"kind": kind.value, FILE: path.name}
        return read_section(Spec, {"rig": {}, **nest({**described, **overridden})})
    name = SPEC_NAME if path.is_dir() else path.name
    text = source.read(name, field="import", most_bytes=SPEC_BYTES)
    try:
        tables = tomllib.loads(text.decode("utf-8"))
    except (UnicodeDecodeError, ValueError, RecursionError) as error:
        raise ConfigError(
            f"{name}: not valid TOML: {error}",
            remedy="docs/reference/file-formats.md shows what stands in import.toml",
        ) from error
    values = {**dict(leaves(tables)), **overridden}
    return read_section(Spec, {"data": {}, "rig": {}, **nest(values)})


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


def _with_tools(source: Source, recorded: Recorded) -> Recorded:
    """Return the presses with indenters of triangles found in the folder."""
    presses = tuple(
        replace(each, indenter=mesh_within(source, each.indenter, field="the presses' indenter"))
        for each in recorded.presses
    )
    return replace(recorded, presses=presses)


def _common(recorded: Recorded) -> dict[str, Any]:
    """Return indenter and place where all presses had the same: the replay's, unless stated."""
    common: dict[str, Any] = {}
    terms = {each.indenter for each in recorded.presses}
    if len(terms) == 1 and (term := terms.pop()):
        common["replay.indenter"] = term
    known = np.array([each.place_m for each in recorded.presses if each.place_m is not None])
    if 0 < len(known) == len(recorded.presses) and np.ptp(known, axis=0).max() <= SAME_PLACE_M:
        common["replay.offset"] = [f"{value:.9g} m" for value in known.mean(axis=0)]
    return common


def mesh_within(source: Source, term: str, *, field: str) -> str:
    """Return an indenter's term; the file of one of triangles has to lie in the folder."""
    if not term.startswith(MESH):
        return term
    name, comma, rest = term.removeprefix(MESH).partition(",")
    path = source.path(name, field=field, most_bytes=FILE_BYTES)
    return f"{MESH}{path}{comma}{rest}"


def _rig(spec: Spec, stated: Mapping[str, Any], recorded: Recorded) -> LoadedConfig:
    """Return the run's configuration: what the source says, over the built-in replay and report."""
    contact = recorded.contact_force_n
    force = FIRST_TOUCH if contact is None else f"{contact:.9g} N"
    ours = {
        "run.name": spec.name or recorded.name,
        "run.sync_mode": recorded.sync_mode,
        **{f"{device}.driver": IMPORTED for device in ("robot", "force_sensor", "camera")},
        "protocol.force_targets": [NO_TARGET],
        "protocol.contact_force": force,
    }
    said = {**recorded.rig, **stated}
    written = {**said, **ours}
    return LoadedConfig(
        config=restore_config(written),
        written=written,
        sources={**dict.fromkeys(said, SPEC_NAME), **dict.fromkeys(ours, "import")},
    )


def _as_toml(written: Mapping[str, Any]) -> str:
    """Return dotted fields as TOML; JSON writes text, numbers and lists alike."""
    lines = (f"{field} = {json.dumps(value)}" for field, value in written.items())
    return "\n".join(["# What was imported says of itself.", *lines, ""])
