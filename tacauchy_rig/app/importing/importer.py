"""From a source and its ``import.toml`` to a run folder, as the store writes its own."""

import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from enum import StrEnum
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field, field_validator

from sim.scene.indenter import Indenter, describe
from sim.scene.scene_parsing import parse_indenter
from sim.sensor.sensor import load_sensor
from tacauchy_rig.app.importing.image_conversion import Converter, Images
from tacauchy_rig.app.importing.plausibility import check_presses
from tacauchy_rig.app.importing.press_detection import Press, Recorded
from tacauchy_rig.app.importing.source_files import MIB, Problems, Source
from tacauchy_rig.app.importing.text_tables import FORMATS, as_toml
from tacauchy_rig.app.replay.simulator_inputs import indenter_of, inputs_of
from tacauchy_rig.core import run
from tacauchy_rig.core.config.field_ranges import Section
from tacauchy_rig.core.config.load import (
    LoadedConfig,
    leaves,
    nest,
    parse_override,
    parse_toml,
    read_section,
    restore_config,
)
from tacauchy_rig.core.config.settings import IMPORTED, RigConfig
from tacauchy_rig.core.errors import ConfigError, RecordError, RigError
from tacauchy_rig.core.registry import Kind, unknown
from tacauchy_rig.core.store.recording.mcap_writer import RecordingWriter
from tacauchy_rig.core.store.run_store import RunStore
from tacauchy_rig.core.versions import versions

PRESSES_MOST = 200
"""Of a run: each image is scored against each simulated one, so 200 make 40,000 scores."""
FRAMES_MOST = 2000
"""Of a press: a minute at 30 Hz."""
CHUNK_BYTES = 4 * 2**20
"""Of a recording that nothing can cut off: it can be made again."""
UNKNOWN_STATE = -1
"""Of an arm that nobody here knows: no state of RTDE's."""


def write_presses(
    store: RunStore, recorded: Recorded, source: Source, converter: Converter, *, kind: str
) -> None:
    """Write presses into a new run folder; what fails leaves none behind.

    Raises:
        RecordError: Something is wrong with the source, its images included, or the disk is full.
    """
    try:
        trials = []
        for index, press in enumerate(recorded.presses[:PRESSES_MOST], start=1):
            _write_press(store, index, press, converter, source)
            there: dict[run.Stream, object] = {"force": press.force, "arm": press.pose}
            there |= {"image": press.frames}
            trials.append(
                run.ImportedTrial(
                    index=index,
                    name=press.name,
                    place_m=press.place_m,
                    indenter=press.indenter,
                    streams=tuple(name for name, stream in there.items() if stream),
                    contact_px=press.contact_px,
                    image=press.frames[-1].name if press.frames else "",
                )
            )
        converter.check_pairs(source.problems, {p.name: p.place_m for p in recorded.presses})
        source.problems.refuse()
        store.imported.save(
            run.Imported(
                kind=kind,
                source=source.name,
                has_clock=recorded.has_clock,
                unknown=recorded.unknown,
                notes=(*recorded.notes, *source.notes, *converter.notes),
                trials=tuple(trials),
                files=dict(source.hashes),
                clock=recorded.clock,
            )
        )
    except (RigError, OSError):
        shutil.rmtree(store.paths.root, ignore_errors=True)
        raise


def _unknown(presses: Sequence[Press], rig: LoadedConfig) -> Iterator[str]:
    """Yield what no press or not every one states, what is assumed, and what is renumbered."""
    lacking = {
        "force": [p.name for p in presses if p.held is None],
        "depth": [p.name for p in presses if p.measured_depth_m is None],
        "position": [p.name for p in presses if p.place_m is None and p.contact_px is None],
        "image": [p.name for p in presses if not p.frames],
    }
    for what, names in lacking.items():
        some = f"{len(names)} of {len(presses)} presses ({', '.join(names)})"
        if names:
            yield f"The {what} of {'a press' if len(names) == len(presses) else some} is not known."
    told = "The {} is not known: {} is assumed (rig.{})."
    if "sensor.name" not in rig.written:
        yield told.format("sensor", rig.config.sensor.name, "sensor.name")
    if rig.config.replay.indenter is None and not all(press.indenter for press in presses):
        yield told.format("indenter", describe(indenter_of(rig.config)), "replay.indenter")
    numbers = [(k, p.name) for k, p in enumerate(presses, start=1) if p.name.isdecimal()]
    if other := [f"trial {k} is its press {name}" for k, name in numbers if int(name) != k]:
        yield f"The source numbers {len(other)} presses otherwise: {other[0]}, see imported.json."


def check_counts(presses: Sequence[Press]) -> Iterator[RecordError]:
    """Yield no press or too many, and presses with too many frames or without those that count."""
    if not 1 <= len(presses) <= PRESSES_MOST:
        yield RecordError(
            f"the source holds {len(presses)} presses; a run has 1 to {PRESSES_MOST}",
            remedy="split it into several folders"
            if presses
            else "check how presses are found: columns, topics, and the force at which one begins",
        )
    for press in presses:
        if len(press.frames) > FRAMES_MOST:
            yield RecordError(
                f"press {press.name}: {len(press.frames)} frames; at most {FRAMES_MOST} are read",
                remedy="leave out frames that show neither the gel at rest nor the press held",
            )
        for lacks, (start, end) in (
            ("has no image of the gel at rest", press.reference),
            ("has no image of the gel while it is pressed", press.dwell),
        ):
            inside = any(start <= frame.stamp_ns <= end for frame in press.frames)
            if press.frames and not inside:
                yield RecordError(
                    f"press {press.name} {lacks}",
                    remedy="record a second without contact before each press; or of a table name "
                    "an image as data.no_contact, or state data.unloaded and data.pressed",
                )


def _write_press(
    store: RunStore, index: int, press: Press, converter: Converter, source: Source
) -> None:
    metadata = {
        "run": store.paths.root.name,
        "trial": str(index),
        "attempt": "1",
        "config_hash": store.config_hash,
        "imported": press.name,
    }
    path = store.paths.recording(index, 1)
    path.parent.mkdir(parents=True)
    with RecordingWriter(path, metadata=metadata, chunk_size=CHUNK_BYTES) as writer:
        for samples, message in ((press.force, _force), (press.pose, _arm)):
            if samples is not None:
                rows = zip(samples.stamp_ns.tolist(), samples.value.tolist(), strict=True)
                writer.write(message(number, *row) for number, row in enumerate(rows))
        for image in _images(press, converter, source):
            writer.write([image])
        writer.close()
        sha256 = writer.sha256
    store.save_result(
        run.TrialRecord(
            index=index,
            attempt=1,
            outcome=run.Outcome.IMPORTED,
            force_target_n=np.nan,
            reason=f"imported: {press.name}",
            contact_z_m=press.contact_z_m,
            depth_measured_m=press.measured_depth_m,
            dwell_start_ns=press.dwell[0],
            dwell_end_ns=press.dwell[1],
            reference_start_ns=press.reference[0],
            reference_end_ns=press.reference[1],
            recording_sha256=sha256,
            **_forces(press, store.config.force_sensor.compression_sign),
        )
    )


def _force(number: int, stamp_ns: int, wrench: list[float]) -> run.ForceSample:
    return run.ForceSample(stamp_ns=stamp_ns, counter=number, wrench=run.vector6(wrench))


def _arm(_: int, stamp_ns: int, pose: list[float]) -> run.ArmSample:
    return run.ArmSample(
        stamp_ns=stamp_ns,
        controller_time_s=np.nan,
        pose=run.Pose.of(pose),
        velocity=run.vector6([np.nan] * 6),
        runtime_state=UNKNOWN_STATE,
        safety_bits=UNKNOWN_STATE,
        robot_mode=UNKNOWN_STATE,
    )


def _images(press: Press, converter: Converter, source: Source) -> Iterator[run.ImageFrame]:
    """Yield the images of a press; those that are damaged or unlike the rest are noted."""
    rest, same, is_compared = None, [], False
    for number, frame in enumerate(press.frames):
        is_rest = press.reference[0] <= frame.stamp_ns <= press.reference[1]
        with source.problems.noting():
            data, (width, height) = converter.convert(frame.read(), name=frame.name, rest=rest)
            if rest is not None and not is_rest and not is_compared:
                is_compared = True
                converter.compare(press.name, data, rest)
            rest = rest or (data if is_rest else None)
            same += [frame.name] * (data == rest and not is_rest)
            yield run.ImageFrame(
                stamp_ns=frame.stamp_ns,
                counter=number,
                device_stamp_s=None,
                width=width,
                height=height,
                jpeg=data,
            )
    if same and len(same) == sum(f.stamp_ns > press.reference[1] for f in press.frames):
        source.problems.add(
            f"press {press.name}: {same[0]} is the image of the gel at rest, byte for byte",
            remedy="name another image at rest, or correct this press's image",
        )


def _forces(press: Press, sign: int) -> dict[str, Any]:
    """Return the mean force over the dwell, its scatter and its zero, as far as they are known."""
    held = press.held
    if held is None or press.force is None:
        return {}
    tare = None
    if press.tare is not None:
        value = press.force.within(press.tare).value
        tare = run.Tare(
            start_ns=press.tare[0],
            end_ns=press.tare[1],
            mean=run.vector6(value.mean(axis=0).tolist()),
            deviation=run.vector6(value.std(axis=0, ddof=min(1, len(value) - 1)).tolist()),
            sample_count=len(value),
        )
    return {
        "tare_before": tare,
        "force_measured_n": sign * float(held[:, run.FZ].mean()),
        "force_deviation_n": float(held[:, run.FZ].std(ddof=1)) if len(held) > 1 else None,
    }


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
    SourceKind.CSV: ("table_rows", "CsvData", "read_csv_folder"),
    SourceKind.BAG: ("ros_bag", "BagData", "read_bag"),
    SourceKind.TAXIM: ("taxim", "TaximData", "read_taxim"),
    SourceKind.VIDEO: ("video_and_clock_offset", "VideoData", "read_video"),
    SourceKind.RECORDS: ("table_rows", "RecordsData", "read_records"),
    SourceKind.LEROBOT: ("lerobot", "LeRobotData", "read_lerobot"),
}
"""Of each format its module, its ``[data]``, and what reads it: others are not even loaded."""
BARE = {".whl": SourceKind.TAXIM, ".npz": SourceKind.TAXIM}
BARE |= {".mcap": SourceKind.BAG, ".db3": SourceKind.BAG}
"""Files that can be imported without an ``import.toml``."""
KEYS = {
    "force_sign": "rig.force_sensor.compression_sign",
    "force": "the unit of forces (data.columns.force.unit)",
    "depth_sign": "data.columns.depth.sign = -1",
    "depth": "the unit of depths (data.columns.depth.unit)",
    "place": "data.columns.x and y, their unit or sign",
}
_UPWARDS = "that the pose's z grows upwards, away from the gel"
_KEYS = {
    SourceKind.BAG: {
        "force": "what publishes the force (bags are in N)",
        "depth_sign": _UPWARDS,
        "place": "data.pad_centre",
    },
    SourceKind.LEROBOT: {
        "force": "data.force.unit",
        "depth_sign": _UPWARDS,
        "depth": "data.pose.unit",
    },
    SourceKind.VIDEO: {"depth_sign": "data.columns.z.sign = -1", "depth": "data.columns.z.unit"},
}
"""What declares conventions, and what else does by the source's format."""


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


def import_run(path: Path, *, parent: Path, overrides: Sequence[str] = ()) -> RunStore:
    """Import what a file or a folder with ``import.toml`` describes, as a new run in ``parent``.

    Args:
        path: ``import.toml``, the folder that holds it, or one of ``BARE``.
        parent: Where the run's folder goes.
        overrides: ``table.field=value`` over the file, from the command line.

    Raises:
        RigError: Something is wrong; all that was met is told, by field, or by file and line.
    """
    source = Source(path if path.is_dir() else path.parent)
    if not path.is_dir():
        source.name = path.name
    overridden = {k: v for each in overrides for k, v in leaves(parse_override(each))}
    spec = _spec(source, path, overridden)
    problems, recorded = source.problems, _read(source, spec)
    with problems.ending():
        stated = _within(source, dict(leaves(spec.rig)), trusted=overridden)
        rig = _rig(spec, {**recorded.rig, **_common(recorded), **stated}, recorded)
        sensor = load_sensor(rig.config.sensor.name)
    with problems.noting():
        inputs_of(rig.config)
    young_pa = rig.config.replay.young or sensor.material.young_pa
    odd = check_presses(
        recorded.presses,
        _indenters(recorded, rig.config, problems),
        sensor.stiffer(young_pa / sensor.material.young_pa),
        KEYS | _KEYS.get(spec.kind, {}),
        sign=rig.config.force_sensor.compression_sign,
        notes=source.notes,
    )
    for error in (*odd, *check_counts(recorded.presses)):
        problems.note(error)
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
    unknown = (*recorded.unknown, *_unknown(recorded.presses, rig))
    recorded = replace(recorded, unknown=unknown)
    write_presses(store, recorded, source, converter, kind=spec.kind.value)
    return store


def _spec(source: Source, path: Path, overridden: Mapping[str, Any]) -> Spec:
    """Return the description, and over it what the command line says."""
    if not path.is_dir() and (kind := BARE.get(path.suffix)):
        values = {"kind": kind.value, "data.file": path.name}
    else:
        name = SPEC_NAME if path.is_dir() else path.name
        text = source.read(name, field="import", most_bytes=MIB)
        values = dict(leaves(parse_toml(text, origin=name, remedy=FORMATS)))
    tables = {"data": {}, "rig": {}, **nest({**values, **overridden})}
    return read_section(Spec, tables, remedy=FORMATS)


def _within(
    source: Source, stated: Mapping[str, Any], *, trusted: Mapping[str, Any]
) -> dict[str, Any]:
    """Return what the source says of the rig, its files within the folder."""
    within = dict(stated)
    for field in (*PATH_FIELDS, "replay.indenter"):
        value = stated.get(field)
        if not value or not isinstance(value, str) or f"rig.{field}" in trusted:
            continue
        if field == "replay.indenter":
            within[field] = mesh_within(source, value, field=f"rig.{field}")
        elif field != "sensor.name" or unknown(Kind.SENSOR, value):
            within[field] = str(source.path(value, field=f"rig.{field}", most_bytes=FILE_BYTES))
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
    with source.problems.ending():
        data = read_section(getattr(module, kind), spec.data, where="data.", remedy=FORMATS)
        recorded: Recorded = getattr(module, reader)(source, data)
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
            known[""] = parse_indenter(config.replay.indenter, field="rig.replay.indenter")
    for press in recorded.presses:
        if press.indenter in known:
            continue
        known[press.indenter] = None
        try:
            known[press.indenter] = parse_indenter(press.indenter, field=press.indenter_at)
        except ConfigError as error:
            also = " A word of your own has a term under [data.indenters]."
            problems.add(error.message, remedy=f"{error.remedy}.{also}")
    return [known[press.indenter] for press in recorded.presses]


def _common(recorded: Recorded) -> dict[str, Any]:
    """Return indenter and place where all presses had the same: the replay's, unless stated."""
    common: dict[str, Any] = {}
    terms = {each.indenter for each in recorded.presses}
    if len(terms) == 1 and (term := terms.pop()):
        common["replay.indenter"] = term
    known = np.array([each.place_m for each in recorded.presses if each.place_m is not None])
    if 0 < len(known) == len(recorded.presses) and np.ptp(known, axis=0).max() <= run.SAME_PLACE_M:
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
