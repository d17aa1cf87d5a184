"""The contact modes of the paper's figures, run and held against what each should look like."""

import math
import time
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from sim.effects.effect_choice import plan_effects
from sim.effects.press_with_effects import path_for
from sim.scene.indenter import Cylinder, Sphere, describe
from sim.scene.scene import ContactMode, Effect, Output, Preset, Target
from sim.sensor.sensor import Sensor
from sim.solve.loading_path import Hold, LoadingPath
from sim.solve.path_point import PathPoint
from sim.studies.modes.contact_signature import ContactSignature, contact_signature

FRICTION = 0.5
SLIDE_STEP_M = 0.2e-3
# A slide has let go where its resultant grows by less than this in a step.
GROWTH_MAX = 5e-3
PUNCH = Cylinder(diameter_m=5e-3, fillet_m=0.5e-3)
BALL = Sphere(diameter_m=8e-3)
# A ball's whole contact is smooth: its maps want finer faces than a force does.
BALL_PRESET = Preset.BALANCED
DEPTH_M = 0.4e-3
_SLIDE_MAX_M = 2e-3
_TWIST_STEP_RAD, _TWIST_MAX_RAD = 0.1, 0.6
# Every point slides where the tangential sizes' sum comes this close to mu times the normal one.
_SLIDING_SHARE = 0.999


@dataclass(frozen=True, slots=True)
class ModeCriterion:
    """One number of a signature against its limit."""

    name: str
    measured: float
    limit: str
    passed: bool
    judged: bool = True  # false where the run did not come to what it is about, and so failed

    @property
    def verdict(self) -> str:
        """The outcome in a word or two."""
        if not self.judged:
            return "not judged"
        return "ok" if self.passed else "MISSED"


def press_criteria(signature: ContactSignature) -> tuple[ModeCriterion, ...]:
    """Judge a straight press."""
    resultant = float(np.linalg.norm(signature.tangential_n[:2])) / signature.normal_size_n
    return (
        _at_least("tangential traction is radial: mean cosine", signature.radial_share, 0.95),
        _below("tangential resultant in the plane over F_n", resultant, 1e-3),
    )


def slide_criteria(
    before: ContactSignature, signature: ContactSignature, growth: float
) -> tuple[ModeCriterion, ...]:
    """Judge a slide's end; ``growth`` is the last step's, of the resultant over F_n."""
    on_indenter = -np.array(signature.tangential_n)
    cosine = float(on_indenter[0] / np.linalg.norm(on_indenter))
    mobilised = signature.mobilised_friction / FRICTION
    settled = abs(growth) <= GROWTH_MAX
    advance = 1e3 * (signature.centre_m[0] - before.centre_m[0])
    step = f"growth of the tangential resultant in the last {SLIDE_STEP_M * 1e3:g} mm"
    all_slides = "tangential resultant over mu F_n where all slides"
    met = settled and abs(mobilised - 1.0) <= 0.02
    leading = "centre of pressure moved towards the leading edge [mm]"
    return (
        _below("cosine of summed traction on the indenter and motion", cosine, -0.98),
        ModeCriterion(step, growth, f"within {GROWTH_MAX:g}", settled),
        ModeCriterion(all_slides, mobilised, "1 within 0.02", met, judged=settled),
        ModeCriterion(leading, advance, "> 0", advance > 0.0),
    )


def twist_criteria(signature: ContactSignature) -> tuple[ModeCriterion, ...]:
    """Judge a turn."""
    share = signature.circumferential_share
    return (_at_least("tangential traction is circumferential: mean cosine", share, 0.95),)


def _at_least(name: str, measured: float, limit: float) -> ModeCriterion:
    return ModeCriterion(name, measured, f">= {limit:g}", measured >= limit)


def _below(name: str, measured: float, limit: float) -> ModeCriterion:
    return ModeCriterion(name, measured, f"< {limit:g}", measured < limit)


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeRun:
    """A contact mode at its end."""

    name: str  # press, slide or twist
    sensor: Sensor
    indenter: Cylinder | Sphere
    travel: str  # how far it went, for people
    path: LoadingPath
    point: PathPoint
    signature: ContactSignature
    criteria: tuple[ModeCriterion, ...]
    processor_s: float

    @property
    def body(self) -> str:
        """The indenter in words."""
        return describe(self.indenter)

    @property
    def title(self) -> str:
        """Sensor, indenter, mode and travel in words."""
        return f"{self.sensor.title}, {self.body}, {self.name}, {self.travel}"

    @property
    def passed(self) -> bool:
        """Every criterion is met."""
        return all(criterion.passed for criterion in self.criteria)

    def as_json(self) -> dict[str, Any]:
        """Return plain values for ``--json``, units in the keys."""
        return {
            "name": self.name,
            "sensor": self.sensor.name,
            "indenter": self.body,
            "travel": self.travel,
            "friction": FRICTION,
            "passed": self.passed,
            "force_n": [float(value) for value in self.point.force_n],
            "depth_m": self.point.depth_m,
            **asdict(self.signature),
            "processor_s": self.processor_s,
            "criteria": [asdict(criterion) for criterion in self.criteria],
        }


def press_in(sensor: Sensor, indenter: Cylinder | Sphere, *, preset: Preset) -> ModeRun:
    """Press straight down into the whole pad."""
    scene = sensor.scene(
        indenter,
        Target(depth_m=DEPTH_M),
        contact=ContactMode.FRICTION,
        friction=FRICTION,
        preset=preset,
        outputs=frozenset({Output.SHEAR}),
        # The tangential traction is what is asked for, over the whole contact.
        effects=((Effect.FRICTION, True), (Effect.SYMMETRY, False), (Effect.FINITE_STRAIN, True)),
    )
    began = time.process_time()
    path = path_for(scene, plan_effects(scene))
    point = path.advance(DEPTH_M)
    pressed = press_mode(sensor, indenter, path, point)
    return replace(pressed, processor_s=time.process_time() - began)


def press_mode(
    sensor: Sensor, indenter: Cylinder | Sphere, path: LoadingPath, point: PathPoint
) -> ModeRun:
    """Hold a straight press, the start of every mode, against its signature."""
    signature = contact_signature(path.model, point)
    return ModeRun(
        name="press",
        sensor=sensor,
        indenter=indenter,
        travel=f"{point.depth_m * 1e3:g} mm deep",
        path=path,
        point=point,
        signature=signature,
        criteria=press_criteria(signature),
        processor_s=0.0,
    )


def slide_mode(pressed: ModeRun) -> ModeRun:
    """Carry the indenter along x under the same force until its drag grows no more."""
    began, path = time.process_time(), _again(pressed)
    signature = pressed.signature
    travel, growth = 0.0, math.inf
    while abs(growth) > GROWTH_MAX and travel < _SLIDE_MAX_M:
        travel += SLIDE_STEP_M
        point = path.carry(shift_m=(SLIDE_STEP_M, 0.0), hold=Hold.FORCE)
        earlier, signature = signature, contact_signature(path.model, point)
        growth = signature.mobilised_friction / max(earlier.mobilised_friction, 1e-300) - 1.0
    return replace(
        pressed,
        name="slide",
        travel=f"{travel * 1e3:.1f} mm along x",
        point=point,
        signature=signature,
        criteria=slide_criteria(pressed.signature, signature, growth),
        processor_s=time.process_time() - began,
    )


def twist_mode(pressed: ModeRun) -> ModeRun:
    """Turn the indenter about z at the same depth until all but the middle slides."""
    began, path, turned = time.process_time(), _again(pressed), 0.0
    while turned < _TWIST_MAX_RAD:
        turned += _TWIST_STEP_RAD
        point = path.carry(twist_rad=_TWIST_STEP_RAD)
        signature = contact_signature(path.model, point)
        if signature.sliding_friction >= _SLIDING_SHARE * FRICTION:
            break
    return replace(
        pressed,
        name="twist",
        travel=f"{math.degrees(turned):.1f}\N{DEGREE SIGN} about z",
        point=point,
        signature=signature,
        criteria=twist_criteria(signature),
        processor_s=time.process_time() - began,
    )


def _again(pressed: ModeRun) -> LoadingPath:
    """Return the path brought back to where the indenter was just pressed in."""
    pressed.path.advance(pressed.point.depth_m, start=pressed.point)
    return pressed.path
