"""What a run asks of simulators, what its own replay answers, and a baseline without mechanics.

The baseline cuts the indenter's own shape into the gel, as simple simulators draw: nothing bends
next to the indenter, and nothing gives below it.
"""

import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import asdict, fields
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.interpolate import LinearNDInterpolator

from reports.evidence.evidence_types import RunEvidence
from reports.evidence.frames_and_curves import RunReading, readable
from reports.scores.force_uncertainty import predict
from sim.scene.indenter import Indenter, describe
from sim.scene.pad import Pad
from sim.sensor.camera_geometry import CameraGeometry
from tacauchy_rig import __version__
from tacauchy_rig.app.importing.source_files import MIB, Source
from tacauchy_rig.app.importing.text_tables import FORMATS, Column, as_csv, as_toml
from tacauchy_rig.app.replay.chosen_optics import Calibrate, optics_of
from tacauchy_rig.app.replay.rendering import SAMPLES, drawn_image
from tacauchy_rig.app.replay.simulator_inputs import inputs_of, parts_of, sensor_of
from tacauchy_rig.core.arrays import FloatArray, ImageArray
from tacauchy_rig.core.config.field_ranges import Section
from tacauchy_rig.core.config.load import parse_toml, read_section
from tacauchy_rig.core.errors import ConfigError, RecordError
from tacauchy_rig.core.image_codec import ColourOrder, encode_png
from tacauchy_rig.core.quantities import UNITS, Dimension
from tacauchy_rig.core.simulated import (
    IMAGE_S,
    REPLAY_NAME,
    Driven,
    Outputs,
    PressOutput,
    Replay,
    Simulator,
    model_of,
)
from tacauchy_rig.core.store.atomic_write import write_atomically
from tacauchy_rig.core.store.run_store import pack_array, pack_arrays
from tacauchy_rig.core.time_limit_and_progress import say
from tacauchy_rig.core.versions import machine

DESCRIPTION = "simulator.toml"
FORCES = "forces.csv"
IMAGE, HEIGHT, FIELDS = "image.png", "height.npy", "fields.npz"
PRESSURE: Literal["pressure"] = "pressure"
SHEAR = ("shear_x", "shear_y")
DIMENSIONS = {
    "force": Dimension.FORCE,
    "depth": Dimension.LENGTH,
    "height": Dimension.LENGTH,
    PRESSURE: Dimension.PRESSURE,
}


Quantity = Literal["force", "depth", "height", "pressure"]


class Description(Section):
    """All of ``simulator.toml``; the rest is as in ``Simulator``."""

    name: str = Field(pattern=r"^[^\x00-\x1f<>]{1,60}$")
    version: str = Field(pattern=r"^[^\x00-\x1f<>]{1,40}$")
    colour_order: ColourOrder | None = None
    milliseconds_an_image: float | None = Field(default=None, gt=0.0, lt=1e9)
    machine: str = Field(default="", max_length=200)
    fitted_to_these: bool = False
    driven_by: Driven | None = None
    left_out: tuple[int, ...] = ()
    note: str = Field(default="", max_length=600)
    # Of what stands in files without a unit; that of pressure is of shear, too
    units: dict[Quantity, str] = Field(default_factory=dict)
    signs: dict[Quantity, Literal[1, -1]] = Field(default_factory=dict)  # -1: the other way

    @property
    def simulator(self) -> Simulator:
        """The simulator that it describes."""
        return Simulator(**{each.name: getattr(self, each.name) for each in fields(Simulator)})

    def column(self, name: Quantity, *, file: str) -> Column:
        """Return a column of a name of ``DIMENSIONS`` with its unit and sign.

        Raises:
            ConfigError: The unit is not stated, or is of something else.
        """
        unit, dimension = self.units.get(name), DIMENSIONS[name]
        if unit is None:
            raise ConfigError(
                f"{DESCRIPTION}: units.{name} is not stated, and {file} has numbers of it",
                remedy=f"write {name} under [units]: one of {', '.join(UNITS[dimension])}",
            )
        column = Column(column=name, unit=unit, sign=self.signs.get(name, 1))
        column.factor(dimension, field=f"{DESCRIPTION}: units.{name}")
        return column

    def factor(self, name: Quantity, *, file: str) -> float:
        """Return what numbers of a file are multiplied by to be SI; raises as ``column``."""
        return self.column(name, file=file).factor(DIMENSIONS[name], field=DESCRIPTION)


def read_description(source: Source) -> Description:
    """Read the description of a folder.

    Raises:
        RecordError: It has no ``simulator.toml``.
        ConfigError: It is damaged, or has a value that is not allowed.
    """
    data = source.read(DESCRIPTION, field="the simulator's description", most_bytes=MIB)
    tables = parse_toml(data, origin=str(source.root / DESCRIPTION), remedy=FORMATS)
    return read_section(Description, tables, where=f"{DESCRIPTION}: ", remedy=FORMATS)


def check_empty(folder: Path) -> None:
    """Refuse a folder that holds something, before much is computed for it.

    Raises:
        RecordError: It does, or is none.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise RecordError(
            f"{folder}: is not empty, and old presses must not mix with new ones",
            remedy="give --out another folder, or empty it",
        )


def write_outputs(folder: Path, outputs: Outputs) -> None:
    """Write a folder that ``judge`` takes. RecordError: It is not empty, or cannot be written."""
    check_empty(folder)
    about = {
        **asdict(outputs.simulator),
        "colour_order": ColourOrder.RGB.value,
        "left_out": list(outputs.left_out),
    }
    stated = {key: value for key, value in about.items() if value is not None}
    units = {"force": "N", "depth": "m", "height": "m", PRESSURE: "Pa"}
    write_atomically(folder / DESCRIPTION, f"{as_toml(stated)}\n[units]\n{as_toml(units)}".encode())
    pairs = [(trial, press.force_n, press.depth_m) for trial, press in outputs.presses.items()]
    if rows := [row for row in pairs if row[1:] != (None, None)]:
        write_atomically(folder / FORCES, as_csv([("press", "force", "depth"), *rows]))
    for trial, press in outputs.presses.items():
        place = folder / f"{trial:02d}"
        if press.image is not None:
            write_atomically(place / IMAGE, encode_png(press.image))
        if press.height_m is not None:
            write_atomically(place / HEIGHT, pack_array(press.height_m.astype(np.float32)))
        shear = () if press.shear_pa is None else np.moveaxis(press.shear_pa, -1, 0)
        maps = {PRESSURE: press.pressure_pa, **dict(zip(SHEAR, shear, strict=False))}
        known = {name: each.astype(np.float32) for name, each in maps.items() if each is not None}
        if known:
            write_atomically(place / FIELDS, pack_arrays(known))


OURS = "tacauchy_rig"
TASK, PRESSES, NO_CONTACT = "task.toml", "presses.csv", "no_contact.png"
_COLUMNS = ("press", "force_n", "depth_m", "place_x_m", "place_y_m", "indenter")
"""Of ``presses.csv``; the place is the tip's in the pad's frame."""


def references_of(evidence: RunEvidence) -> dict[int, ImageArray]:
    """Return the no-contact frames by trial, as far as they can be read."""
    return {t.index: t.images.reference for t in evidence.trials if t.images is not None}


def write_task(folder: Path, run: RunReading, evidence: RunEvidence) -> None:
    """Write what a simulator has to know of a run to press its presses.

    All is SI, with units in the names; docs/reference/file-formats.md explains each. Depths are
    below the height at which F_z was ``contact_force_n``, and what is not known is empty.

    Raises:
        RecordError: The folder cannot be written.
    """
    config = run.store.config
    view = sensor_of(config).camera
    task = {
        "run": str(evidence.provenance.get("name", "")),
        "sensor": config.sensor.name,
        "friction": config.replay.friction,
        "contact_force_n": evidence.contact_force_n,
        "width_px": view.width,
        "height_px": view.height,
        "scale_x_m_px": view.scale_x_m,
        "scale_y_m_px": view.scale_y_m,
        "centre_x_px": view.centre_x_px,
        "centre_y_px": view.centre_y_px,
        "rows_grow_with_y": not view.mirrored,
    }
    write_atomically(folder / TASK, as_toml(task).encode())
    write_atomically(folder / PRESSES, as_csv([_COLUMNS, *_asked(run, evidence)]))
    for trial, image in references_of(evidence).items():
        write_atomically(folder / f"{trial:02d}" / NO_CONTACT, encode_png(image))


def _asked(run: RunReading, evidence: RunEvidence) -> Iterator[tuple[object, ...]]:
    """Yield what each press was, in the order of ``_COLUMNS``."""
    inputs, imported = inputs_of(run.store.config), evidence.imported
    others = {} if imported is None else {trial.index: trial for trial in imported.trials}
    for trial in evidence.trials:
        record, other = trial.record, others.get(trial.index)
        force_n = None if record is None else record.force_measured_n
        depth_m = None if record is None else record.depth_measured_m
        place = inputs.offset_m if other is None else other.place_m
        term = (other.indenter if other else "") or describe(inputs.indenter)
        yield trial.index, force_n, depth_m, *(place or (None, None)), term


def replay_outputs(run: RunReading, evidence: RunEvidence) -> Outputs | None:
    """Return what the run's replay gives, as of any simulator; None where it was not replayed.

    Forces are those that the stated gel predicts at the measured depths, not the matched ones,
    which agree by construction.
    """
    store = run.store
    if REPLAY_NAME not in store.replays():
        return None
    replay = readable(lambda: store.load_replay(REPLAY_NAME))
    if replay is None:
        return None
    x_m, y_m = sensor_of(store.config).camera.pad_grid()
    presses, missing = {}, []
    for trial in evidence.trials:
        if trial.simulated_image is None and trial.replay is None:
            missing.append(trial.index)
            continue
        kept = readable(partial(store.load_replay_fields, REPLAY_NAME, trial.index))
        heights, fields = ({}, {}) if kept is None else (kept.height, kept.fields)
        has_heights = {"loaded_m", "rest_m"} <= heights.keys()
        presses[trial.index] = PressOutput(
            image=trial.simulated_image,
            force_n=predict(trial, evidence.contact_force_n)[0],
            height_m=heights["loaded_m"] - heights["rest_m"] if has_heights else None,
            pressure_pa=surface_values(fields, "contact_pressure_pa", x_m, y_m),
            shear_pa=surface_values(fields, "contact_shear_pa", x_m, y_m),
        )
    return Outputs(simulator=_who(replay), presses=presses, left_out=tuple(missing))


def surface_values(
    fields: Mapping[str, NDArray[Any]], name: str, x_m: FloatArray, y_m: FloatArray
) -> FloatArray | None:
    """Return a replayed trial's pressure or shear at places of the pad; None without one.

    Of a vector the components along x and y, on a last axis of 2.
    """
    if not {"node_m", name} <= fields.keys():
        return None
    values = fields[name] if fields[name].ndim == 1 else fields[name][:, :2]
    at = LinearNDInterpolator(fields["node_m"][:, :2], values, fill_value=0.0)
    return np.asarray(at(x_m, y_m), dtype=np.float64)


def _who(replay: Replay) -> Simulator:
    model = replay.model
    known = [trial.wall_s for trial in replay.trials if IMAGE_S in trial.wall_s]
    total_s = sum(sum(wall.values()) for wall in known)
    is_timed = bool(known) and math.isfinite(total_s)  # from a press's force to its image
    return Simulator(
        name=OURS,
        version=replay.versions.get("tacauchy-rig", __version__),
        milliseconds_an_image=1e3 * total_s / len(known) if is_timed else None,
        machine=f"{model.device}, {machine()}",
        driven_by=Driven.DEPTH,
        note=f"Replay of the measured forces, preset {model.preset}; its time is the search for "
        "the force, on meshes that bound its error, and the image.",
    )


def rigid_outputs(run: RunReading, *, calibrate: Calibrate | None) -> Outputs:
    """Return what a simulator without mechanics shows of a run's presses.

    Args:
        calibrate: As for ``optics_of``.

    Raises:
        RecordError: No press has a measured depth and a no-contact frame.
    """
    replay = run.store.load_replay(REPLAY_NAME) if REPLAY_NAME in run.store.replays() else None
    inputs_by_trial = {n: part.inputs for part in parts_of(run) for n in part.trials}
    sensor = next(iter(inputs_by_trial.values())).sensor
    optics = optics_of(run.store.config.sensor.optics_calibration, sensor, calibrate=calibrate)
    presses, spent_s = {}, 0.0
    for trial, record in run.records.items():
        attempt = run.attempt(trial)
        unloaded = None if attempt is None else attempt.reference
        if record is None or record.depth_measured_m is None or unloaded is None:
            say(f"press {trial}: no depth or no no-contact frame: left out")
            continue
        started, place_m = time.perf_counter(), inputs_by_trial[trial].offset_m
        if replay is not None:  # it may have found where the tip came down
            model = model_of(replay.models, trial)
            place_m = (model.centre_x_m, model.centre_y_m)
        cut = partial(
            rigid_heights,
            sensor.pad,
            inputs_by_trial[trial].indenter,
            depth_m=record.depth_measured_m,
            place_m=place_m,
        )
        image = drawn_image(*cut(optics.geometry.refined(SAMPLES)), optics, unloaded=unloaded)
        spent_s += time.perf_counter() - started
        rest, loaded = cut(optics.geometry)
        presses[trial] = PressOutput(image=image, height_m=loaded - rest)
    if not presses:
        raise RecordError(
            f"{run.store.paths.root}: no press of it has a measured depth",
            remedy="a rigid indenter goes as deep as the run measured: record or import depths",
        )
    simulator = Simulator(
        name="rigid penetration",
        version=__version__,
        milliseconds_an_image=1e3 * spent_s / len(presses),
        machine=f"cpu, {machine()}",
        note="No mechanics: the indenter's shape cut into the gel at the measured depth, through "
        "our optics.",
    )
    missing = tuple(trial for trial in run.records if trial not in presses)
    return Outputs(simulator=simulator, presses=presses, left_out=missing)


def rigid_heights(
    pad: Pad,
    indenter: Indenter,
    geometry: CameraGeometry,
    *,
    depth_m: float,
    place_m: tuple[float, float] = (0.0, 0.0),
) -> tuple[FloatArray, FloatArray]:
    """Return z of the surface at rest and cut by an upright indenter [m], each [height, width].

    Args:
        depth_m: Of the tip below the pad's top at its place [m].
        place_m: Where the tip comes down, in the pad's frame [m].
    """
    x, y = geometry.pad_grid()
    rest = np.asarray(pad.height_at(x, y), dtype=np.float64)
    top = float(pad.height_at(np.array([place_m[0]]), np.array([place_m[1]]))[0])
    underside = top - depth_m + indenter.lower_surface(x - place_m[0], y - place_m[1])
    return rest, np.asarray(np.minimum(rest, underside))
