"""Causes of the residual of a replay's images, found by coarse presses with each cause changed."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from reports.evidence.evidence_types import TrialImages
from reports.evidence.frames_and_curves import AttemptReading
from reports.figures.trial_axis import spread
from reports.scores.residual_causes import Cause, Mode, split_residual
from sim.effects.planned_effects import full_plan
from sim.effects.press_with_effects import path_for
from sim.fields.saved_press import SurfaceState, surface_state
from sim.optics.markers.marker_tracking import find_markers
from sim.scene.indenter import MeshIndenter
from sim.scene.scene import Preset
from sim.tilt_sensitivity import COARSE, can_tilt
from tacauchy_rig.app.replay.chosen_optics import OpticalCalibration
from tacauchy_rig.app.replay.input_uncertainty import NEARLY_UPRIGHT, rounded_rim
from tacauchy_rig.app.replay.rendering import image_of
from tacauchy_rig.app.replay.simulator_inputs import ReplayInputs
from tacauchy_rig.core.arrays import FloatArray, ImageArray
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.config.stated_uncertainty import stated_uncertainty
from tacauchy_rig.core.errors import RigError
from tacauchy_rig.core.simulated import ResidualSplit
from tacauchy_rig.core.time_limit_and_progress import say

MOST_TRIALS, _MOST_PARTS = 12, 6
"""Trials that are pressed again, spread evenly over the forces: each takes two seconds."""
# Steps: large against the scatter of a coarse mesh, small against the curvature of the response
# (steps half as large find half of a planted tilt or modulus).
_MORE = 1.15
_TILT_RAD = math.radians(1.0)
_POISSON = -0.02
# Assumed standard uncertainties: of a lamp's brightness by ageing or another exposure, of light
# drifting within a press, of the lens's blur and of the scale since the calibration.
_LAMP, _DRIFT, _BLUR_PX, _SCALE = 0.1, 0.02, 0.3, 0.01
_UNIFORM = 1.0 / math.sqrt(3.0)
_COLOURS = ("red", "green", "blue")
Images = dict[int, FloatArray]


def split_images(
    parts: Sequence[tuple[ReplayInputs, Sequence[AttemptReading]]],
    images: Mapping[int, ImageArray],
    forces_n: Mapping[int, float],
    optics: OpticalCalibration,
    config: RigConfig,
) -> ResidualSplit | None:
    """Split the residual of a replay's images by its causes; None where that is not possible.

    Args:
        parts: Trials of one indenter at one place, with the modulus that they were pressed with.
            Each has its own coarse presses; the unknowns are common to all.
        forces_n: Simulated, for trials without a measured one [N].
    """
    pressable = [part for part in parts if not isinstance(part[0].indenter, MeshIndenter)]
    if len(pressable) < len(parts):
        say("  the residual is not split for mesh indenters: their presses take minutes")
    found = [(inputs, _presses(attempts, images, forces_n)) for inputs, attempts in pressable]
    chosen = spread([part for part in found if part[1]], _MOST_PARTS)
    again = [
        _Again(spread(presses, MOST_TRIALS // len(chosen)), inputs, optics, config)
        for inputs, presses in chosen
    ]
    seen = {press.index: press.images for part in again for press in part.presses}
    view, offset_m = optics.geometry, stated_uncertainty(config, "offset").value
    try:
        return split_residual(
            seen,
            {index: image for index, image in images.items() if index in seen},
            (mode for part in again for mode in part.modes()),
            pose_px=(offset_m / view.scale_x_m, offset_m / view.scale_y_m),
        )
    except RigError as error:
        say(f"  the residual is not split because a coarse press failed: {error.message}")
        return None


@dataclass(frozen=True, slots=True)
class _Press:
    """A trial's force [N] and images; ``bare`` is its no-contact frame without markers."""

    index: int
    force_n: float
    images: TrialImages
    bare: ImageArray


def _presses(
    attempts: Sequence[AttemptReading],
    images: Mapping[int, ImageArray],
    forces_n: Mapping[int, float],
) -> list[_Press]:
    """Return those that can be pressed again, the smallest force first."""
    found = []
    for attempt in attempts:
        record = attempt.record
        force_n = record.force_measured_n or forces_n.get(record.index, 0.0)
        if force_n <= 0.0 or record.index not in images or attempt.images is None:
            continue
        reference = attempt.images.reference
        markers = find_markers(reference)
        bare = reference if markers is None else markers.bare
        found.append(_Press(record.index, force_n, attempt.images, bare))
    return sorted(found, key=lambda press: press.force_n)


@dataclass(frozen=True, slots=True)
class _Again:
    """The presses of a run again, coarsely, the smallest force first."""

    presses: Sequence[_Press]
    inputs: ReplayInputs
    optics: OpticalCalibration
    config: RigConfig

    def modes(self) -> Iterator[Mode]:
        """Yield every mode."""
        say(f"  {len(self.presses)} images: coarse presses with other forces")
        forces_n = [press.force_n for press in self.presses]
        tried = sorted({f * by for f in forces_n for by in (1.0 / _MORE, 1.0, _MORE)})
        upright = self._pressed(self.inputs.tilted(NEARLY_UPRIGHT, 0.0), tried)
        pressed = dict(zip(tried, upright, strict=True))
        less, even, more = ([pressed[f * by] for f in forces_n] for by in (1.0 / _MORE, 1.0, _MORE))
        base = self._seen(even)
        by_force = _apart(self._seen(more), self._seen(less), 1.0 / (_MORE - 1.0 / _MORE))
        yield from self._of_force(by_force)
        say("  coarse presses with another Poisson's ratio and other tilts")
        yield from self._of_material(by_force, base)
        if can_tilt(self.inputs.indenter):
            yield from self._of_tilt()
        change = {press.index: base[press.index] - press.bare for press in self.presses}
        say("  images with other lamps, blur and scale")
        yield from self._of_light(change)
        yield from self._of_optics(change, even, base)

    def _of_force(self, by_force: Images) -> Iterator[Mode]:
        """Yield errors of the force: in proportion, the same in all trials, of one trial."""
        scale = stated_uncertainty(self.config, "force_scale").value
        yield Mode("force, in proportion", Cause.FORCE, scale, "1", _times(by_force, scale))
        zero_n = _UNIFORM * self.config.protocol.drift
        of_zero = {p.index: zero_n / p.force_n * by_force[p.index] for p in self.presses}
        yield Mode("force, all trials alike", Cause.FORCE, zero_n, "N", of_zero)
        for index, changed in of_zero.items():
            yield Mode(f"force of trial {index}", Cause.FORCE, zero_n, "N", {index: changed})

    def _of_material(self, by_force: Images, base: Images) -> Iterator[Mode]:
        """Yield modulus and Poisson's ratio; a stiffer gel answers like a smaller force."""
        sensor = self.inputs.sensor
        young = sensor.young_uncertainty()[0]
        yield Mode("modulus", Cause.MATERIAL, young, "1", _times(by_force, -young))
        ratio = sensor.least_certain_poisson.uncertainty
        other = replace(
            self.inputs.tilted(NEARLY_UPRIGHT, 0.0), sensor=sensor.with_poisson(_POISSON)
        )
        changed = _apart(self._seen(self._pressed(other)), base, ratio / _POISSON)
        yield Mode("Poisson's ratio", Cause.MATERIAL, ratio, "1", changed)

    def _of_tilt(self) -> Iterator[Mode]:
        size = stated_uncertainty(self.config, "tilt").value
        for name, (x, y) in (("x", (_TILT_RAD, 0.0)), ("y", (0.0, _TILT_RAD))):
            there, back = (
                self._seen(self._pressed(self.inputs.tilted(sign * x, sign * y)))
                for sign in (1, -1)
            )
            changed = _apart(there, back, 0.5 * size / _TILT_RAD)
            yield Mode(f"lean towards {name}", Cause.TILT, size, "rad", changed)

    def _of_light(self, change: Images) -> Iterator[Mode]:
        """Yield lamps of another brightness, and light that drifts from frame to frame."""
        for k, colour in enumerate(_COLOURS):
            only = np.eye(3)[k]
            lamp = {i: _LAMP * only * each for i, each in change.items()}
            yield Mode(f"{colour} lamp", Cause.LIGHT, _LAMP, "1", lamp)
            drift = {press.index: _DRIFT * only * press.bare for press in self.presses}
            since = f"{colour} light since the no-contact frame"
            yield Mode(since, Cause.LIGHT, _DRIFT, "1", drift)

    def _of_optics(
        self, change: Images, surfaces: Sequence[SurfaceState], base: Images
    ) -> Iterator[Mode]:
        """Yield gradients of brightness over the image, the lens's blur, and the scale."""
        view = self.optics.geometry
        for name, count, axis in (("x", view.width, 1), ("y", view.height, 0)):
            along = np.expand_dims(np.linspace(-1.0, 1.0, count), (2, 1 - axis))
            for k, colour in enumerate(_COLOURS):
                bent = {i: _LAMP * np.eye(3)[k] * along * each for i, each in change.items()}
                yield Mode(f"{colour} lamp along {name}", Cause.OPTICS, _LAMP, "1", bent)
        blurred = replace(self.optics, blur_px=self.optics.blur_px + _BLUR_PX)
        changed = _apart(self._seen(surfaces, blurred), base, 1.0)
        yield Mode("blur", Cause.OPTICS, _BLUR_PX, "px", changed)
        for name in "xy":
            wide = {f"scale_{name}_m": getattr(view, f"scale_{name}_m") * (1.0 + _SCALE)}
            scaled = replace(self.optics, geometry=replace(view, **wide))
            changed = _apart(self._seen(surfaces, scaled), base, 1.0)
            yield Mode(f"scale along {name}", Cause.OPTICS, _SCALE, "1", changed)

    def _pressed(
        self, inputs: ReplayInputs, forces_n: Sequence[float] | None = None
    ) -> list[SurfaceState]:
        """Press to rising forces [N]; None is those that were measured."""
        measured = [press.force_n for press in self.presses]
        plain = replace(inputs, sensor=inputs.sensor.relaxing(()), tolerance=None)
        # One mesh for all: under a ball it follows the largest force.
        scene = plain.scene([_MORE * measured[-1]])
        coarse = replace(
            scene,
            indenter=rounded_rim(scene.indenter),
            preset=Preset.FAST,
            refinement=COARSE,
            outputs=frozenset(),
        )
        path = path_for(coarse, full_plan(coarse))
        return [surface_state(path, path.push(force_n)) for force_n in forces_n or measured]

    def _seen(
        self, surfaces: Sequence[SurfaceState], optics: OpticalCalibration | None = None
    ) -> Images:
        sensor, seen = self.inputs.sensor, optics or self.optics
        return {
            press.index: image_of(surface, sensor, seen, unloaded=press.bare).astype(np.float64)
            for press, surface in zip(self.presses, surfaces, strict=True)
        }


def _times(images: Images, factor: float) -> Images:
    return {index: factor * image for index, image in images.items()}


def _apart(images: Images, others: Images, factor: float) -> Images:
    return {index: factor * (image - others[index]) for index, image in images.items()}
