"""From a source and its ``import.toml`` to a run folder."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from enum import StrEnum
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field, field_validator

from sim.scene.indenter import Indenter
from sim.scene.terms import parse_indenter
from sim.sensor.sensor import load_sensor
from tacauchy_rig.app.importing.images import Converter, Images
from tacauchy_rig.app.importing.plausible import Keys, check_presses
from tacauchy_rig.app.importing.presses import Recorded
from tacauchy_rig.app.importing.source import MIB, Problems, Source
from tacauchy_rig.app.importing.table import as_toml, read_section
from tacauchy_rig.app.importing.writing import check_counts, write_presses
from tacauchy_rig.core.config.fields import Section
from tacauchy_rig.core.config.load import LoadedConfig, leaves, nest, parse_override, restore_config
from tacauchy_rig.core.config.model import IMPORTED, RigConfig
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.registry import Kind, unknown
from tacauchy_rig.core.run import SAME_PLACE_M
from tacauchy_rig.core.store.run_store import RunStore
from tacauchy_rig.core.versions import versions

RIG_TABLES = ("sensor", "replay", "report", "uncertainty")
RIG_FIELDS = ("force_sensor.to_tip", "force_sensor.compression_sign", "robot.tool_rotation")
"""What of ``rig.toml`` a source may say: the rest is of devices that it does not have."""
PATH_FIELDS = ("sensor.name", "sensor.optics_calibration")
"""Of these, names that may be files: they are looked for in the folder."""
SPEC_NAME = "import.toml"
FIRST_TOUCH = "0.001 mN"
"""Below the resolution of any cell: depth counts from first touch."""
MESH = "mesh:"
FILE_BYTES = 256 * MIB
"""Of a calibration, a sensor's file or a tool's triangles."""


class SourceKind(StrEnum):
    """Formats that can be imported."""

    CSV = "csv"
    BAG = "bag"
    TAXIM = "taxim"
    VIDEO = "video"
    RECORDS = "records"
    LEROBOT = "lerobot"


READERS: Mapping[SourceKind, tuple[str, str, str]] = {
    SourceKind.CSV: ("rows", "CsvData", "read_csv_folder"),
    SourceKind.BAG: ("bag", "BagData", "read_bag"),
    SourceKind.TAXIM: ("taxim", "TaximData", "read_taxim"),
    SourceKind.VIDEO: ("video", "VideoData", "read_video"),
    SourceKind.RECORDS: ("records", "RecordsData", "read_records"),
    SourceKind.LEROBOT: ("lerobot", "LeRobotData", "read_lerobot"),
}
"""Of each format its module, its ``[data]``, and what reads it: others are not even loaded."""
BARE = {".whl": SourceKind.TAXIM, ".npz": SourceKind.TAXIM}
BARE |= {".mcap": SourceKind.BAG, ".db3": SourceKind.BAG}
"""Files that can be imported without an ``import.toml``."""
KEYS = Keys(
    force_sign="rig.force_sensor.compression_sign = -1",
    force="the unit of forces (data.columns.force.unit)",
    depth_sign="data.columns.depth.sign = -1",
    depth="the unit of depths (data.columns.depth.unit)",
    place="data.columns.x and y, their unit or sign",
)
_STREAM = replace(KEYS, depth_sign="that the pose's z grows upwards, away from the gel")
_KEYS = {
    SourceKind.BAG: replace(
        _STREAM, force="what publishes the force (bags are in N)", place="data.pad_centre"
    ),
    SourceKind.LEROBOT: replace(_STREAM, force="data.force.unit", depth="data.pose.unit"),
    SourceKind.VIDEO: replace(
        _STREAM, depth_sign="data.columns.z.sign = -1", depth="data.columns.z.unit"
    ),
}
"""What declares conventions, by the source's format."""


class Spec(Section):
    """All of ``import.toml``; docs/reference/file-formats.md explains each key."""

    kind: SourceKind
    name: str | None = Field(default=None, pattern=r"^[A-Za-z0-9_.-]{1,60}$")
    simulated: bool = False
    data: dict[str, Any]
    rig: dict[str, Any]
    images: Images = Images()

    @field_validator("rig")
    @classmethod
    def _is_of_the_replay(cls, tables: dict[str, Any]) -> dict[str, Any]:
        for name, _ in leaves(tables):
            if name.partition(".")[0] not in RIG_TABLES and name not in RIG_FIELDS:
                known = ", ".join((*(f"rig.{table}" for table in RIG_TABLES), *RIG_FIELDS))
                raise ValueError(f'"{name}" says nothing of an imported run; it may say: {known}')
        return tables


def import_run(
    path: Path,
    *,
    parent: Path,
    overrides: Sequence[str] = (),
    check: Callable[[RigConfig], object] = lambda _: None,
) -> RunStore:
    """Import what a file or a folder with ``import.toml`` describes, as a new run in ``parent``.

    Args:
        path: ``import.toml``, the folder that holds it, or one of ``BARE``.
        parent: Where the run's folder goes.
        overrides: ``table.field=value`` over the file, from the command line.
        check: Refuses a configuration that nothing can be replayed with.

    Raises:
        RigError: Something is wrong; all that was met is told, by field, or by file and line.
    """
    source = Source(path if path.is_dir() else path.parent)
    if not path.is_dir():
        source.name = path.name
    overridden = {k: v for each in overrides for k, v in leaves(parse_override(each))}
    spec = _spec(source, path, overridden)
    problems, stated = source.problems, None
    with problems.noting():
        stated = _within(source, dict(leaves(spec.rig)), trusted=overridden)
    recorded = _read(source, spec)
    if stated is None:
        raise problems.all_in_one
    rig = _rig(spec, {**recorded.rig, **_common(recorded), **stated}, recorded)
    with problems.noting():
        check(rig.config)
    sensor = None
    with problems.noting():
        sensor = load_sensor(rig.config.sensor.name)
    if sensor is None:
        raise problems.all_in_one
    young_pa = rig.config.replay.young or sensor.material.young_pa
    check_presses(
        recorded.presses,
        _indenters(recorded, rig.config, problems),
        replace(sensor, material=replace(sensor.material, young_pa=young_pa)),
        _KEYS.get(spec.kind, KEYS),
        sign=rig.config.force_sensor.compression_sign,
        problems=problems,
    )
    with problems.noting():
        check_counts(recorded)
    if not recorded.presses:
        problems.refuse()
    store = RunStore.create(
        parent,
        rig,
        config_text=f"# What was imported says of itself.\n{as_toml(rig.written)}",
        simulated=spec.simulated,
        versions=versions(),
    )
    converter = Converter(how=spec.images, camera=sensor.camera)
    write_presses(store, recorded, source, converter, kind=spec.kind.value)
    return store


def _spec(source: Source, path: Path, overridden: Mapping[str, Any]) -> Spec:
    """Return the description, and over it what the command line says."""
    if not path.is_dir() and (kind := BARE.get(path.suffix)):
        values = {"kind": kind.value, "data.file": path.name}
    else:
        name = SPEC_NAME if path.is_dir() else path.name
        text = source.read(name, field="import", most_bytes=MIB)
        try:
            values = dict(leaves(tomllib.loads(text.decode("utf-8"))))
        except (ValueError, RecursionError) as error:
            raise ConfigError(
                f"{name}: not valid TOML: {error}",
                remedy="docs/reference/file-formats.md lists the keys of import.toml",
            ) from error
    return read_section(Spec, {"data": {}, "rig": {}, **nest({**values, **overridden})})


def _within(
    source: Source, stated: Mapping[str, Any], *, trusted: Mapping[str, Any]
) -> dict[str, Any]:
    """Return what the source says of the rig, its files within the folder."""
    within = dict(stated)
    for field, value in stated.items():
        if f"rig.{field}" in trusted or not isinstance(value, str):
            continue
        if field == "sensor.name" and not unknown(Kind.SENSOR, value):
            continue
        if field in PATH_FIELDS and value:
            within[field] = str(source.path(value, field=f"rig.{field}", most_bytes=FILE_BYTES))
        elif field == "replay.indenter":
            within[field] = mesh_within(source, value, field=f"rig.{field}")
    return within


def mesh_within(source: Source, term: str, *, field: str) -> str:
    """Return an indenter's term; the file of one of triangles has to lie in the folder."""
    if not term.startswith(MESH):
        return term
    name, comma, rest = term.removeprefix(MESH).partition(",")
    path = source.path(name, field=field, most_bytes=FILE_BYTES)
    return f"{MESH}{path}{comma}{rest}"


def _read(source: Source, spec: Spec) -> Recorded:
    """Return what the source holds, as far as it can be read; refuses where nothing of it can."""
    name, kind, reader = READERS[spec.kind]
    module = import_module(f"tacauchy_rig.app.importing.{name}")
    recorded: Recorded = Recorded(presses=(), has_clock=False)
    with source.problems.noting():
        data = read_section(getattr(module, kind), spec.data, where="data.")
        recorded = getattr(module, reader)(source, data)
    if not recorded.presses:
        source.problems.refuse()
    presses = []
    for each in recorded.presses:
        with source.problems.noting():
            term = mesh_within(source, each.indenter, field="the presses' indenter")
            presses.append(replace(each, indenter=term))
    return replace(recorded, presses=tuple(presses))


def _indenters(recorded: Recorded, config: RigConfig, problems: Problems) -> list[Indenter | None]:
    """Return the indenter of each press; terms that name none are noted where they stand."""
    known: dict[str, Indenter | None] = {"": None}
    if config.replay.indenter:
        with problems.noting():
            known[""] = parse_indenter(config.replay.indenter)
    for press in recorded.presses:
        if press.indenter in known:
            continue
        known[press.indenter] = None
        try:
            known[press.indenter] = parse_indenter(press.indenter)
        except ConfigError as error:
            told = error.message.removeprefix("--indenter ")
            also = " A word of your own has a term under [data.indenters]."
            problems.add(f"{press.indenter_at}: {told}", remedy=f"{error.remedy}.{also}")
    return [known[press.indenter] for press in recorded.presses]


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


def _rig(spec: Spec, stated: dict[str, Any], recorded: Recorded) -> LoadedConfig:
    """Return the run's configuration: what the source says, over the built-in replay and report."""
    contact = recorded.contact_force_n
    ours = {
        "run.name": spec.name or recorded.name,
        "run.sync_mode": recorded.sync_mode,
        **{f"{device}.driver": IMPORTED for device in ("robot", "force_sensor", "camera")},
        "protocol.force_targets": ["0 N"],  # an import has none; a configuration has to name one
        "protocol.contact_force": FIRST_TOUCH if contact is None else f"{contact:.9g} N",
    }
    written = {**stated, **ours}
    return LoadedConfig(
        config=restore_config(written),
        written=written,
        sources={**dict.fromkeys(stated, SPEC_NAME), **dict.fromkeys(ours, "import")},
    )
