"""What a run is replayed with, checked before a press, and its parts.

A part are presses of one indenter at one place, which share a mesh.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, Self, TypeVar

import numpy as np

from reports.evidence.frames_and_curves import AttemptReading, RunReading
from sim.cheapest_setting import keeping, setting_of
from sim.effects.effect_choice import PRESET_TOLERANCE
from sim.optics.colour.nominal_optics import nominal_model
from sim.replay import replay_scene
from sim.scene.indenter import Cylinder, Indenter, Sphere, describe
from sim.scene.scene import Drive, Output, Preset, Scene, Target
from sim.scene.scene_parsing import parse_indenter
from sim.sensor.sensor import Sensor, load_sensor
from sim.tolerance import Tolerance, parse_tolerance
from tacauchy_rig.app.replay.chosen_optics import calibrated_optics
from tacauchy_rig.core.config.settings import IndenterKind, RigConfig
from tacauchy_rig.core.errors import ConfigError, RecordError, command_line
from tacauchy_rig.core.registry import Kind, names, unknown
from tacauchy_rig.core.run import SAME_PLACE_M, ImportedTrial, TrialRecord
from tacauchy_rig.core.simulated import FoundValue

_Closed = TypeVar("_Closed", bound=StrEnum)

AUTO = "auto"
"""In place of a preset: the cheapest with a stated accuracy of F_z of 3 %, or else ``balanced``."""
OF_AUTO = Tolerance(relative=0.03)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayInputs:
    """What a run's measured forces are pressed with."""

    sensor: Sensor
    indenter: Indenter
    preset: Preset
    drive: Drive
    force_tolerance_n: float  # largest |F_z simulated - measured| [N]
    # Take the cheapest preset that keeps it; None takes ``preset``
    tolerance: Tolerance | None = None
    # ``preset`` counts only until forces are known, or if no cheaper one is accurate enough for
    # them
    is_auto: bool = False
    refinement: float = 1.0  # every edge is this many times shorter than the preset's
    # Relative error of F_z that omitted effects may cause; None is the preset's
    effects_error: float | None = None
    # The tolerance that preset and refinement were chosen for
    stated_accuracy: Tolerance | None = None
    friction: float = 0.0  # Coulomb coefficient between indenter and gel
    # How far the indenter's axis is tilted towards x and y of the pad, from the tip upwards [rad];
    # a scene states the same tilt as rotations (-y, x) about x and y
    tilt_rad: tuple[float, float] = (0.0, 0.0)
    # Where its tip comes down, from the pad's centre along x and y [m]
    offset_m: tuple[float, float] = (0.0, 0.0)
    duration_s: float = 1.0  # time from touch to dwell [s], for a gel that relaxes

    def scene(self, forces_n: Sequence[float]) -> Scene:
        """Return the press to the largest of some forces [N]."""
        scene = replay_scene(
            self.sensor,
            self.indenter,
            forces_n,
            preset=self.preset,
            drive=self.drive,
            tolerance_n=self.force_tolerance_n,
            friction=self.friction,
            tilt_rad=(-self.tilt_rad[1], self.tilt_rad[0]),
            centre_m=self.offset_m,
            duration_s=self.duration_s,
        )
        if self.tolerance is not None:
            return keeping(scene, self.tolerance)
        return replace(scene, refinement=self.refinement, tolerance=self.effects_error)

    @property
    def asked_accuracy(self) -> Tolerance | None:
        """What a press alone at its place is to keep; None where a preset was named.

        Nor where its result depends on the path's steps: with printed markers, whose motion is
        scored, or with a gel that relaxes.
        """
        if self.sensor.markers is not None or self.sensor.material.relaxation:
            return None
        return self.tolerance or (OF_AUTO if self.is_auto else None)

    def quick_scene(self, target: Target) -> Scene:
        """Return the press to a target with steps as long as the force allows."""
        scene = replace(self, tolerance=None, refinement=1.0, effects_error=None).scene([])
        outputs = frozenset(Output) - {Output.SHEAR, Output.MARKERS}
        return replace(scene, target=target, outputs=outputs)

    @property
    def upright(self) -> Self:
        """The same press with an indenter that is not tilted."""
        return replace(self, tilt_rad=(0.0, 0.0))

    def tilted(self, x_rad: float, y_rad: float) -> Self:
        """Return the press with the indenter tilted further towards x and y [rad]."""
        return replace(self, tilt_rad=(self.tilt_rad[0] + x_rad, self.tilt_rad[1] + y_rad))

    def stiffer(self, factor: float) -> Self:
        """Return the press of a gel that is this many times as stiff."""
        return replace(self, sensor=self.sensor.stiffer(factor))

    def moved(self, by_m: tuple[float, float]) -> Self:
        """Return the press at a place that is shifted along x and y [m]."""
        return replace(self, offset_m=(self.offset_m[0] + by_m[0], self.offset_m[1] + by_m[1]))

    def settled(self, forces_n: Sequence[float]) -> Self:
        """Return the inputs with the preset that ``auto`` chooses for some forces [N].

        It chooses the mesh alone: omitted effects may cost what the named preset allows. Without
        a force it is the preset that stands in its place.
        """
        if not self.is_auto:
            return self
        named = replace(self, is_auto=False)
        if not forces_n:
            return named
        try:
            chosen = keeping(named.scene(forces_n), OF_AUTO)
        except ConfigError:
            return named
        return replace(
            named,
            preset=chosen.preset,
            refinement=chosen.refinement,
            effects_error=PRESET_TOLERANCE[self.preset],
            stated_accuracy=OF_AUTO,
        )


def inputs_of(config: RigConfig) -> ReplayInputs:
    """Return what a configuration is replayed with.

    Raises:
        ConfigError: It names a sensor, law, indenter, preset, tolerance or drive that there is
            not; the message has the field and what there is.
    """
    asked = config.replay
    is_auto = asked.preset == AUTO
    return ReplayInputs(
        sensor=sensor_of(config),
        indenter=indenter_of(config),
        preset=Preset.BALANCED
        if is_auto
        else _member(Preset, asked.preset, "replay.preset", "preset", others=[AUTO]),
        drive=_member(Drive, asked.drive, "replay.drive", "way to reach a force"),
        force_tolerance_n=asked.force_tolerance,
        tolerance=parse_tolerance(asked.tolerance, field="replay.tolerance")
        if asked.tolerance is not None
        else None,
        is_auto=is_auto and asked.tolerance is None,
        friction=asked.friction,
        tilt_rad=asked.tilt or (0.0, 0.0),
        offset_m=asked.offset or (0.0, 0.0),
    )


def sensor_of(config: RigConfig) -> Sensor:
    """Load the configured sensor with the configured material.

    Raises:
        ConfigError: There is no such sensor or law, or the sensor has layers and one material is
            configured.
    """
    sensor = load_sensor(config.sensor.name)
    material = sensor.material
    if sensor.layers and (config.replay.young, config.replay.poisson) != (None, None):
        raise ConfigError(
            f"replay.young and replay.poisson do not say which layer of {sensor.title} is meant",
            remedy="leave them out, and name a sensor file of your own with its layers",
        )
    if config.replay.young is not None:
        material = replace(material, young_pa=config.replay.young)
    if config.replay.poisson is not None:
        material = replace(material, poisson=config.replay.poisson)
    law = config.replay.law or material.law
    if unknown(Kind.LAW, law):
        raise ConfigError(
            f"replay.law: {law!r} is no law", remedy=f"one of: {', '.join(names(Kind.LAW))}"
        )
    sensor = replace(sensor, material=material).with_gel(law=law)
    return sensor if config.replay.relaxation else sensor.with_gel(relaxation=())


def indenter_of(config: RigConfig) -> Indenter:
    """Return the configured indenter for the simulator.

    Raises:
        ConfigError: ``replay.indenter`` is not understood, or its file bounds no body.
    """
    if config.replay.indenter is not None:
        return parse_indenter(config.replay.indenter, field="replay.indenter")
    given = config.indenter
    if given.kind is IndenterKind.SPHERE:
        return Sphere(diameter_m=given.diameter)
    return Cylinder(diameter_m=given.diameter, fillet_m=given.fillet)


def _member(
    kind: type[_Closed], value: str, field: str, what: str, *, others: Sequence[str] = ()
) -> _Closed:
    try:
        return kind(value)
    except ValueError as error:
        raise ConfigError(
            f"{field}: {value!r} is no {what}",
            remedy=f"one of: {', '.join([*others, *(known.value for known in kind)])}",
        ) from error


def check_optics(config: RigConfig, sensor: Sensor, given: str | None = None) -> str:
    """Refuse unusable optics before the simulation; return in words which they are.

    Args:
        given: Calibration file in place of the configured one.

    Raises:
        ConfigError: The calibration file is missing or damaged, or of images of another size or
            scale; or there is none, nothing of the rig is emulated, and the sensor's file names
            no lamps.
    """
    given = config.sensor.optics_calibration if given is None else given
    if given:
        calibrated_optics(given, sensor)
        return f"optics from {given}"
    if config.has_emulated_devices and sensor.optics.renderer.exponents is not None:
        return "optics calibrated on the emulated sensor"
    nominal_model(sensor)
    return "nominal optics of the sensor's file, not calibrated"


def check_replay(config: RigConfig) -> str:
    """Refuse what cannot be replayed before anything is pressed; return what a replay would use.

    Raises:
        ConfigError: As ``inputs_of`` and ``check_optics`` do, and if no preset keeps the tolerance.
    """
    inputs = inputs_of(config)
    scene = inputs.scene(config.protocol.force_targets)
    chosen = AUTO if inputs.is_auto else setting_of(scene)
    kept = "" if inputs.tolerance is None else f" for a tolerance of {inputs.tolerance}"
    return f"{inputs.sensor.title}, preset {chosen}{kept}, {check_optics(config, inputs.sensor)}"


DEPTH_SHARE = 0.8
"""Of the gel's height in the middle: what is left of a DIGIT's 2.5 mm over the window is 0.5 mm."""
PRESSURE_MODULI = 5.0
"""Young's moduli that the mean pressure may reach: silicones tear at a few times their modulus."""


def check_gel(config: RigConfig) -> str:
    """Refuse limits beyond what the sensor's gel bears.

    Returns:
        The gel and what the limits leave of it, in words.

    Raises:
        ConfigError: ``limits.max_depth`` goes through the gel, or ``limits.hard_force`` tears it;
            each is named.
    """
    sensor = sensor_of(config)
    height_m = sensor.pad.height_m
    stiffest_pa = max(
        (layer.material.young_pa for layer in sensor.layers), default=sensor.material.young_pa
    )
    pressure_pa = config.limits.hard_force / (math.pi * config.indenter.diameter**2 / 4.0)
    problems = []
    if config.limits.max_depth > DEPTH_SHARE * height_m:
        problems.append(
            f"limits.max_depth: {config.limits.max_depth * 1e3:g} mm is more than "
            f"{DEPTH_SHARE:.0%} of the gel of {sensor.title}, {height_m * 1e3:g} mm high; write at "
            f'most "{DEPTH_SHARE * height_m * 1e3:.3g} mm"'
        )
    if pressure_pa > PRESSURE_MODULI * stiffest_pa:
        most_n = config.limits.hard_force * PRESSURE_MODULI * stiffest_pa / pressure_pa
        problems.append(
            f"limits.hard_force: {config.limits.hard_force:g} N under an indenter of "
            f"{config.indenter.diameter * 1e3:g} mm are {pressure_pa * 1e-6:.2g} MPa, more than "
            f"{PRESSURE_MODULI:g} times the modulus of the gel of {sensor.title}, "
            f'{stiffest_pa * 1e-6:g} MPa: it tears; write at most "{most_n:.3g} N"'
        )
    if problems:
        raise ConfigError(
            "\n".join(problems), remedy="correct the limit, sensor.name or indenter.diameter"
        )
    return (
        f"{sensor.title}, {height_m * 1e3:g} mm high: max_depth leaves "
        f"{(height_m - config.limits.max_depth) * 1e3:.3g} mm of it, hard_force presses with "
        f"{pressure_pa * 1e-6:.2g} MPa on {stiffest_pa * 1e-6:g} MPa"
    )


Place = tuple[float, float]
_FEW = 4
"""Parts of an indenter that tell of all, about."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """Trials that are pressed with one model; it can go to another process."""

    inputs: ReplayInputs
    records: tuple[TrialRecord, ...]  # of the trials that have a force, or else a depth
    config: RigConfig  # the run's, with their indenter and place
    trials: tuple[int, ...] = ()  # numbers of all trials, also of those that have neither
    place_known: bool = True  # it is stated where the tip came down
    label: str = ""  # indenter and place, for progress; empty where all trials are alike
    # Tilt and place of the indenter that were found, and the plan's rows on them, as replays keep
    # these
    found: tuple[FoundValue, ...] = ()
    effects: tuple[dict[str, Any], ...] = ()

    @property
    def forces_n(self) -> list[float]:
        """Measured forces [N], of the trials that have one."""
        return [r.force_measured_n for r in self.records if r.force_measured_n is not None]

    @property
    def depths_m(self) -> list[float]:
        """Measured depths [m], of the trials that have one."""
        return [r.depth_measured_m for r in self.records if r.depth_measured_m]

    @property
    def is_alone(self) -> bool:
        """Whether its one trial, of several parts, may be pressed on a mesh whose bias is known.

        Not where its depth counts from a force, which a path has to go to first.
        """
        from_touch = bool(self.forces_n) or not self.config.protocol.contact_force
        accurate = self.inputs.asked_accuracy is not None
        return bool(self.label) and len(self.records) == 1 and accurate and from_touch

    @property
    def settled(self) -> Self:
        """The part with the preset that ``auto`` chooses."""
        return replace(self, inputs=self.inputs.settled(self.forces_n))


def parts_of(run: RunReading, *, tolerance: Tolerance | None = None) -> list[Part]:
    """Return the parts of a run: one, unless it was imported and its presses differ.

    Of several parts nothing is pressed yet to choose a preset.

    Args:
        tolerance: Counts more than the configured one.

    Raises:
        ConfigError: An indenter, or what a replay is made with, does not exist.
        RecordError: The run was imported, and the file that says so is missing or damaged.
    """
    trials, config = run.store.imported_trials, run.store.config
    groups = _alike(trials)
    is_placed = config.replay.offset is not None

    def part_of(reading: RunReading, config: RigConfig, label: str, *, place_known: bool) -> Part:
        inputs = inputs_of(config)
        if tolerance is not None:
            inputs = replace(inputs, tolerance=tolerance, is_auto=False)
        return Part(
            inputs=inputs,
            records=tuple(_measured(reading)),
            config=config,
            trials=tuple(reading.records),
            place_known=place_known or is_placed,
            label=label,
        )

    if len(groups) <= 1:
        places = [trial.place_m for trial in trials.values()]
        part = part_of(run, config, "", place_known=None not in places)
        forces_n = part.forces_n if config.is_imported else config.protocol.force_targets
        return [replace(part, inputs=part.inputs.settled(forces_n))]
    parts = []
    for group in groups:
        place, indenter = group[0].place_m, group[0].indenter
        if places := [trial.place_m for trial in group if trial.place_m is not None]:
            x_m, y_m = np.mean(places, axis=0).tolist()
            place = x_m, y_m
        stated = {"indenter": indenter or None, "offset": place}
        known = {name: value for name, value in stated.items() if value is not None}
        own = config.model_copy(update={"replay": config.replay.model_copy(update=known)})
        reading = run.of([trial.index for trial in group])
        where = "place unknown"
        if place is not None:
            where = f"at {place[0] * 1e3:.2f}, {place[1] * 1e3:.2f} mm"
        label = f", {indenter or 'the indenter of the run'}, {where}"
        parts.append(part_of(reading, own, label, place_known=place is not None))
    return parts


def measured_records(run: RunReading) -> tuple[TrialRecord, ...]:
    """Return the trials that have a force to replay; of an imported run also those with a depth.

    Raises:
        RecordError: There is none.
    """
    measured = tuple(_measured(run))
    if not measured:
        root = run.store.paths.root
        raise RecordError(
            f"{root}: no trial has a measured force to replay",
            remedy=f"`{command_line('resume', root)}` records them",
        )
    return measured


def measured_attempts(run: RunReading) -> list[AttemptReading]:
    """Return the attempts that ``measured_records`` names."""
    return [run.read(record) for record in measured_records(run)]


def tools_of(parts: Sequence[Part]) -> Iterator[list[int]]:
    """Yield the numbers of the parts of each indenter."""
    groups: dict[str, list[int]] = {}
    for k, part in enumerate(parts):
        groups.setdefault(describe(part.inputs.indenter), []).append(k)
    yield from groups.values()


def some_of_each(parts: Sequence[Part]) -> list[int]:
    """Return the numbers of the parts that tell of all: a few of each indenter, evenly taken."""
    return [k for own in tools_of(parts) for k in own[:: max(1, len(own) // _FEW)]]


def _measured(run: RunReading) -> Iterator[TrialRecord]:
    for record in run.records.values():
        if record is None:
            continue
        by_depth = run.store.config.is_imported and record.depth_measured_m is not None
        if record.force_measured_n is not None or by_depth:
            yield record


def _alike(trials: dict[int, ImportedTrial]) -> list[list[ImportedTrial]]:
    """Return trials grouped by indenter and place, in order of the first."""
    groups: list[list[ImportedTrial]] = []
    for trial in trials.values():
        for group in groups:
            if group[0].indenter == trial.indenter and _is_near(group[0].place_m, trial.place_m):
                group.append(trial)
                break
        else:
            groups.append([trial])
    return groups


def _is_near(first: Place | None, second: Place | None) -> bool:
    if first is None or second is None:
        return first is second
    return max(abs(a - b) for a, b in zip(first, second, strict=True)) <= SAME_PLACE_M
