"""The contact modes of the paper's figures, run and held against what each should look like."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

from sim.effects.plan import plan_effects
from sim.press import path_for
from sim.scene.indenter import Cylinder, Sphere, describe
from sim.scene.scene import ContactMode, Effect, Preset, Scene, Target
from sim.sensor.sensor import Sensor
from sim.solve.load_steps.equilibrium import PathPoint
from sim.solve.load_steps.path import Hold, LoadingPath
from sim.studies.modes.criteria import (
    FRICTION,
    GROWTH_MAX,
    SLIDE_STEP_M,
    ModeCriterion,
    press_criteria,
    slide_criteria,
    twist_criteria,
)
from sim.studies.modes.signatures import ContactSignature, contact_signature

PUNCH = Cylinder(diameter_m=5e-3, fillet_m=0.5e-3)
BALL = Sphere(diameter_m=8e-3)
# A ball's whole contact is smooth: its edge wants finer faces than a force does.
BALL_REFINEMENT = 1.25
DEPTH_M = 0.4e-3
_SLIDE_MAX_M = 2e-3
_TWIST_STEP_RAD, _TWIST_MAX_RAD = 0.1, 0.6
# Every point slides where the tangential sizes' sum comes this close to mu times the normal one.
_SLIDING_SHARE = 0.999


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeRun:
    """A contact mode at its end.

    Attributes:
        name: press, slide or twist.
        travel: How far it went, for people.
        processor_s: Processor's time for it [s].
    """

    name: str
    sensor: Sensor
    indenter: Cylinder | Sphere
    travel: str
    path: LoadingPath
    point: PathPoint
    signature: ContactSignature
    criteria: tuple[ModeCriterion, ...]
    processor_s: float

    @property
    def title(self) -> str:
        """Sensor, indenter, mode and travel in words."""
        body = describe(self.indenter)
        return f"{self.sensor.title}, {body}, {self.name}, {self.travel}"

    @property
    def passed(self) -> bool:
        """Every criterion is met."""
        return all(criterion.passed for criterion in self.criteria)

    def as_json(self) -> dict[str, Any]:
        """Return plain values for ``--json``, units in the keys."""
        signature = self.signature
        return {
            "name": self.name,
            "sensor": self.sensor.name,
            "indenter": describe(self.indenter),
            "travel": self.travel,
            "friction": FRICTION,
            "passed": self.passed,
            "force_n": [float(value) for value in self.point.force_n],
            "depth_m": self.point.depth_m,
            "normal_n": signature.normal_n,
            "normal_sum_n": signature.normal_sum_n,
            "tangential_n": signature.tangential_n,
            "tangential_sum_n": signature.tangential_sum_n,
            "centre_m": signature.centre_m,
            "circumferential_share": signature.circumferential_share,
            "radial_share": signature.radial_share,
            "inward_share": signature.inward_share,
            "radial_share_points": signature.radial_share_points,
            "processor_s": self.processor_s,
            "criteria": [
                {
                    "name": criterion.name,
                    "measured": criterion.measured,
                    "limit": criterion.limit,
                    "passed": criterion.passed,
                    "judged": criterion.judged,
                }
                for criterion in self.criteria
            ],
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Pressed:
    """An indenter pressed into a sensor with friction, the start of every mode."""

    sensor: Sensor
    indenter: Cylinder | Sphere
    path: LoadingPath
    point: PathPoint
    processor_s: float = 0.0

    def again(self) -> LoadingPath:
        """Return the path brought back to where the indenter was just pressed in."""
        self.path.advance(self.point.depth_m, start=self.point)
        return self.path


def press_in(
    sensor: Sensor,
    indenter: Cylinder | Sphere,
    *,
    preset: Preset,
    depth_m: float = DEPTH_M,
    refinement: float = 1.0,
) -> Pressed:
    """Press straight down into the whole pad.

    Args:
        refinement: Make every edge this many times shorter than the preset does.

    Raises:
        ConvergenceError: There is no equilibrium.
    """
    scene = Scene(
        pad=sensor.pad,
        material=sensor.material,
        layers=sensor.layers,
        indenter=indenter,
        target=Target(depth_m=depth_m),
        contact=ContactMode.FRICTION,
        friction=FRICTION,
        preset=preset,
        sensor=sensor.name,
        # The tangential traction is what is asked for, over the whole contact.
        effects=((Effect.FRICTION, True), (Effect.SYMMETRY, False), (Effect.FINITE_STRAIN, True)),
    )
    began = time.process_time()
    path = path_for(scene, plan_effects(scene), refinement=refinement)
    point = path.advance(depth_m)
    spent = time.process_time() - began
    return Pressed(sensor=sensor, indenter=indenter, path=path, point=point, processor_s=spent)


def press_mode(pressed: Pressed) -> ModeRun:
    """Hold a straight press against its signature."""
    criteria = press_criteria(contact_signature(pressed.path.model, pressed.point))
    travel = f"{pressed.point.depth_m * 1e3:g} mm deep"
    return _run("press", pressed, pressed.point, travel, criteria, pressed.processor_s)


def slide_mode(pressed: Pressed) -> ModeRun:
    """Carry the indenter along x under the same force until its drag grows no more.

    Raises:
        ConvergenceError: There is no equilibrium.
    """
    began, path = time.process_time(), pressed.again()
    before = signature = contact_signature(path.model, pressed.point)
    travel, growth = 0.0, math.inf
    while abs(growth) > GROWTH_MAX and travel < _SLIDE_MAX_M:
        travel += SLIDE_STEP_M
        point = path.carry(shift_m=(SLIDE_STEP_M, 0.0), hold=Hold.FORCE)
        earlier, signature = signature, contact_signature(path.model, point)
        growth = signature.mobilised_friction / max(earlier.mobilised_friction, 1e-300) - 1.0
    return _run(
        "slide",
        pressed,
        point,
        f"{travel * 1e3:.1f} mm along x",
        slide_criteria(before, signature, growth),
        time.process_time() - began,
    )


def twist_mode(pressed: Pressed) -> ModeRun:
    """Turn the indenter about z at the same depth until all but the middle slides.

    Raises:
        ConvergenceError: There is no equilibrium.
    """
    began, path, turned = time.process_time(), pressed.again(), 0.0
    while turned < _TWIST_MAX_RAD:
        turned += _TWIST_STEP_RAD
        point = path.carry(twist_rad=_TWIST_STEP_RAD)
        signature = contact_signature(path.model, point)
        if signature.sliding_friction >= _SLIDING_SHARE * FRICTION:
            break
    return _run(
        "twist",
        pressed,
        point,
        f"{math.degrees(turned):.1f}\N{DEGREE SIGN} about z",
        twist_criteria(signature),
        time.process_time() - began,
    )


def _run(
    name: str,
    pressed: Pressed,
    point: PathPoint,
    travel: str,
    criteria: tuple[ModeCriterion, ...],
    processor_s: float,
) -> ModeRun:
    return ModeRun(
        name=name,
        sensor=pressed.sensor,
        indenter=pressed.indenter,
        travel=travel,
        path=pressed.path,
        point=point,
        signature=contact_signature(pressed.path.model, point),
        criteria=criteria,
        processor_s=processor_s,
    )
