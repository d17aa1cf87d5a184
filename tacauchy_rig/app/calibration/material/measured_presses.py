"""Forces at depths, from recorded runs and from tables of others."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from reports.evidence.frames_and_curves import readable
from sim.scene.indenter import Cylinder, Sphere, describe
from sim.scene.scene_parsing import parse_indenter
from tacauchy_rig.app.importing.source_files import Source
from tacauchy_rig.app.importing.text_tables import Column, read_table
from tacauchy_rig.app.replay.open_run import open_run
from tacauchy_rig.app.replay.simulator_inputs import Part, ReplayInputs, inputs_of, parts_of
from tacauchy_rig.core.arrays import FloatArray, IndexArray
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.config.settings import RigConfig, stated_uncertainty
from tacauchy_rig.core.errors import ConfigError, RecordError
from tacauchy_rig.core.quantities import Dimension
from tacauchy_rig.core.simulated import REPLAY_NAME, FoundValue, Replay, model_of

COLUMNS = ("indenter", "depth_mm", "force_n")
_SAME_DEPTH_M, _DEEPEST_SHARE = 1e-6, 0.8


@dataclass(frozen=True, slots=True, kw_only=True)
class IndenterPresses:
    """What was measured with one indenter."""

    config: RigConfig  # states the uncertainties of indenter, mounting, cell and heights
    inputs: ReplayInputs
    contact_force_n: float  # force from which depths count [N]; 0 is first touch
    # Of each point, shape [point_count]: number of its press, depth, force, and the force's noise
    press: IndexArray
    depth_m: FloatArray
    force_n: FloatArray
    noise_n: FloatArray
    found: tuple[FoundValue, ...] = ()  # tilt and place that the run's replay fitted
    simulated: bool = False  # whether the run's devices were emulated

    @property
    def name(self) -> str:
        """The indenter as the command line writes it."""
        return describe(self.inputs.indenter)

    @property
    def press_count(self) -> int:
        """Series that have a zero of depth of their own."""
        return 1 + int(self.press.max())

    @property
    def zero_doubt_m(self) -> float:
        """Standard uncertainty of a series' zero of depth [m]."""
        return stated_uncertainty(self.config, "depth").value

    @property
    def point_names(self) -> list[str]:
        """What every point is called in messages."""
        return [f"{self.name} at {depth * 1e3:.4g} mm" for depth in self.depth_m]

    @property
    def scatter_n(self) -> float | None:
        """Standard deviation of forces at one depth [N], pooled; None without repeats."""
        _, which = np.unique(np.round(self.depth_m / _SAME_DEPTH_M), return_inverse=True)
        means = np.bincount(which, self.force_n) / np.bincount(which)
        degrees = len(which) - len(means)
        squares = float(np.sum((self.force_n - means[which]) ** 2))
        return math.sqrt(squares / degrees) if degrees else None


def read_presses(
    paths: Sequence[Path], *, overrides: Sequence[str], noise_n: float, contact_force_n: float
) -> list[IndenterPresses]:
    """Read run folders and CSV files; one entry for each indenter.

    Args:
        overrides: ``table.field=value`` of the configuration of CSV files.
        noise_n: Of a force of a CSV file [N].
        contact_force_n: From which the depths of CSV files count [N].

    Raises:
        RecordError: A folder is no run's, a table cannot be read, or too little is in them.
        ConfigError: They are of several sensors, of triangles, or a gel has layers.
    """
    of_table = partial(
        _of_table, overrides=overrides, noise_n=noise_n, contact_force_n=contact_force_n
    )
    found: dict[str, IndenterPresses] = {}
    for path in paths:
        for each in _of_run(path) if path.is_dir() else of_table(path):
            known = found.get(each.name)
            found[each.name] = each if known is None else _together(known, each)
    groups = [  # a noise is at least what repeats scatter by
        replace(each, noise_n=np.maximum(each.noise_n, each.scatter_n or 0.0))
        for each in found.values()
    ]
    _refuse(groups)
    return groups


def _refuse(groups: Sequence[IndenterPresses]) -> None:
    sensors = sorted({each.inputs.sensor.name for each in groups})
    if len(sensors) > 1:
        raise ConfigError(
            f"presses of several sensors: {', '.join(sensors)}", remedy="calibrate one at a time"
        )
    if groups and groups[0].inputs.sensor.layers:
        raise ConfigError(
            f"the gel of {sensors[0]} has layers, and the fit finds the modulus of one material",
            remedy="give a sensor without layers",
        )
    for each in groups:
        height_m = each.inputs.sensor.pad.height_m
        if (deepest_m := float(each.depth_m.max())) > _DEEPEST_SHARE * height_m:
            raise RecordError(
                f"{each.name}: a depth of {deepest_m * 1e3:.4g} mm in a gel of "
                f"{height_m * 1e3:.4g} mm is beyond what can be simulated",
                remedy="give depths in millimetres, and leave out what is close to the base",
            )
        if not isinstance(each.inputs.indenter, Cylinder | Sphere):
            raise ConfigError(
                f"{each.name}: the fit simulates 11 presses, which take minutes each for a mesh",
                remedy="press with a ball or a cylinder",
            )


def _together(first: IndenterPresses, second: IndenterPresses) -> IndenterPresses:
    if first.contact_force_n != second.contact_force_n:
        raise ConfigError(
            f"{first.name}: depths count from {first.contact_force_n:g} N and from "
            f"{second.contact_force_n:g} N",
            remedy="calibrate from one of them, or give --contact-force for the tables",
        )
    return replace(
        first,
        press=np.concatenate([first.press, second.press + first.press.max() + 1]),
        depth_m=np.concatenate([first.depth_m, second.depth_m]),
        force_n=np.concatenate([first.force_n, second.force_n]),
        noise_n=np.concatenate([first.noise_n, second.noise_n]),
    )


def _of_run(folder: Path) -> list[IndenterPresses]:
    run = open_run(folder)
    replay = readable(lambda: run.store.load_replay(REPLAY_NAME))
    simulated = run.store.simulated
    parts = (_of_part(part, replay, simulated=simulated) for part in parts_of(run))
    found = [each for each in parts if each is not None]
    if not found:
        raise RecordError(
            f"{folder}: no trial has a depth and a force",
            remedy="record a run whose trials have both",
        )
    return found


def _of_part(part: Part, replay: Replay | None, *, simulated: bool) -> IndenterPresses | None:
    rows = [
        (record.depth_measured_m, record.force_measured_n, record.force_deviation_n or 0.0)
        for record in part.records
        if record.depth_measured_m and record.force_measured_n
    ]
    if not rows:
        return None
    depth, force, noise = np.array(rows).T
    return IndenterPresses(
        config=part.config,
        inputs=replace(part.settled.inputs, tolerance=None),
        contact_force_n=part.config.protocol.contact_force,
        press=np.arange(len(rows)),
        depth_m=depth,
        force_n=force,
        noise_n=noise,
        found=() if replay is None else model_of(replay.models, min(part.trials)).found,
        simulated=simulated,
    )


def _of_table(
    path: Path, *, overrides: Sequence[str], noise_n: float, contact_force_n: float
) -> Iterator[IndenterPresses]:
    source, whole = Source(path.resolve().parent), path.resolve().name
    table, field = read_table(source, whole, field="PRESSES"), "PRESSES"
    indenter, depth_name, force_name = COLUMNS
    names = np.array(table.text(indenter, field=field))
    depth_m, force_n = (
        table.numbers(Column(column=name, unit=unit), dimension, field=field)
        for name, unit, dimension in (
            (depth_name, "mm", Dimension.LENGTH),
            (force_name, "N", Dimension.FORCE),
        )
    )
    source.problems.refuse()
    if len(wrong := np.flatnonzero(~((depth_m > 0.0) & (force_n > 0.0)))):
        k = int(wrong[0])
        cells = [table.cells(name)[k] for name in COLUMNS[1:]]
        raise RecordError(
            f"{table.where(k)}: {depth_name} {cells[0]!r} and {force_name} {cells[1]!r} are not "
            "both above 0",
            remedy="leave out points without contact; depths are positive into the gel",
        )
    # Without a column press the lines of an indenter are one series: they share a zero of depth.
    presses = table.cells("press") if "press" in table.columns else [""] * len(names)
    for term in dict.fromkeys(names.tolist()):
        own = names == term
        rows = np.flatnonzero(own).tolist()
        order = list(dict.fromkeys(presses[k] for k in rows))
        parse_indenter(term, field=f'{table.where(rows[0])}, column "{indenter}"')
        config = load_config(overrides=(*overrides, f'replay.indenter="{term}"')).config
        yield IndenterPresses(
            config=config,
            inputs=inputs_of(config),
            contact_force_n=contact_force_n,
            press=np.array([order.index(presses[k]) for k in rows]),
            depth_m=depth_m[own],
            force_n=force_n[own],
            noise_n=np.full(len(rows), noise_n),
        )
