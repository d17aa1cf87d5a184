"""The contact modes of the paper's figures, run and held against what each should look like."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim.contact_modes import ContactSignature, contact_signature
from sim.effects import plan_effects
from sim.indenter import Cylinder, Sphere, describe
from sim.loading import Hold, LoadingPath, PathPoint
from sim.press import path_for
from sim.scene import ContactMode, Effect, Preset, Scene, Target
from sim.sensor import Sensor

FRICTION = 0.5
PUNCH = Cylinder(diameter_m=5e-3, fillet_m=0.5e-3)
BALL = Sphere(diameter_m=8e-3)
DEPTH_M = 0.4e-3
_SLIDE_STEP_M, _SLIDE_MAX_M = 0.2e-3, 2e-3
_TWIST_STEP_RAD, _TWIST_MAX_RAD = 0.1, 0.6
# A sum of tangential forces this close to mu F_n slides everywhere.
_SLIDING_SHARE = 0.999


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeCriterion:
    """One number of a signature against its limit."""

    name: str
    measured: float
    limit: str
    passed: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeRun:
    """A contact mode at its end.

    Attributes:
        name: press, slide or twist.
        travel: How far it went, for people.
    """

    name: str
    sensor: Sensor
    indenter: Cylinder | Sphere
    travel: str
    path: LoadingPath
    point: PathPoint
    signature: ContactSignature
    criteria: tuple[ModeCriterion, ...]

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
            "tangential_n": signature.tangential_n,
            "tangential_sum_n": signature.tangential_sum_n,
            "centre_m": signature.centre_m,
            "circumferential_share": signature.circumferential_share,
            "radial_share": signature.radial_share,
            "inward_share": signature.inward_share,
            "criteria": [
                {
                    "name": criterion.name,
                    "measured": criterion.measured,
                    "limit": criterion.limit,
                    "passed": criterion.passed,
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

    def again(self) -> LoadingPath:
        """Return the path brought back to where the indenter was just pressed in."""
        self.path.advance(self.point.depth_m, start=self.point)
        return self.path


def press_in(
    sensor: Sensor, indenter: Cylinder | Sphere, *, preset: Preset, depth_m: float = DEPTH_M
) -> Pressed:
    """Press straight down into the whole pad.

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
    path = path_for(scene, plan_effects(scene))
    return Pressed(sensor=sensor, indenter=indenter, path=path, point=path.advance(depth_m))


def press_mode(pressed: Pressed) -> ModeRun:
    """Hold a straight press against its signature."""
    signature = contact_signature(pressed.point)
    resultant = float(np.linalg.norm(signature.tangential_n[:2])) / signature.normal_n
    return _run(
        "press",
        pressed,
        pressed.point,
        f"{pressed.point.depth_m * 1e3:g} mm deep",
        (
            _at_least("radial share of the tangential traction", signature.radial_share, 0.95),
            _below("tangential resultant over F_n", resultant, 1e-3),
        ),
    )


def slide_mode(pressed: Pressed) -> ModeRun:
    """Carry the indenter along x under the same force until every point slides, or for 2 mm.

    Raises:
        ConvergenceError: There is no equilibrium.
    """
    path, before = pressed.again(), contact_signature(pressed.point)
    travel = 0.0
    while travel < _SLIDE_MAX_M:
        travel += _SLIDE_STEP_M
        point = path.carry(shift_m=(_SLIDE_STEP_M, 0.0), hold=Hold.FORCE)
        signature = contact_signature(point)
        if signature.sliding_friction >= _SLIDING_SHARE * FRICTION:
            break
    on_indenter = -np.array(signature.tangential_n)
    cosine = float(on_indenter[0] / np.linalg.norm(on_indenter))
    mobilised = signature.mobilised_friction / FRICTION
    advance = signature.centre_m[0] - before.centre_m[0]
    return _run(
        "slide",
        pressed,
        point,
        f"{travel * 1e3:.1f} mm along x",
        (
            _below("cosine of traction on the indenter and motion", cosine, -0.98),
            ModeCriterion(
                name="tangential resultant over mu F_n",
                measured=mobilised,
                limit="1 within 0.02",
                passed=abs(mobilised - 1.0) <= 0.02,
            ),
            ModeCriterion(
                name="centre of pressure moved towards the leading edge [mm]",
                measured=advance * 1e3,
                limit="> 0",
                passed=advance > 0.0,
            ),
        ),
    )


def twist_mode(pressed: Pressed) -> ModeRun:
    """Turn the indenter about z at the same depth until all but the middle slides.

    Raises:
        ConvergenceError: There is no equilibrium.
    """
    path, turned = pressed.again(), 0.0
    while turned < _TWIST_MAX_RAD:
        turned += _TWIST_STEP_RAD
        point = path.carry(twist_rad=_TWIST_STEP_RAD)
        signature = contact_signature(point)
        if signature.sliding_friction >= _SLIDING_SHARE * FRICTION:
            break
    share = signature.circumferential_share
    return _run(
        "twist",
        pressed,
        point,
        f"{math.degrees(turned):.1f}\N{DEGREE SIGN} about z",
        (_at_least("circumferential share of the tangential traction", share, 0.95),),
    )


def _run(
    name: str,
    pressed: Pressed,
    point: PathPoint,
    travel: str,
    criteria: tuple[ModeCriterion, ...],
) -> ModeRun:
    return ModeRun(
        name=name,
        sensor=pressed.sensor,
        indenter=pressed.indenter,
        travel=travel,
        path=pressed.path,
        point=point,
        signature=contact_signature(point),
        criteria=criteria,
    )


def _at_least(name: str, measured: float, limit: float) -> ModeCriterion:
    return ModeCriterion(
        name=name, measured=measured, limit=f">= {limit:g}", passed=measured >= limit
    )


def _below(name: str, measured: float, limit: float) -> ModeCriterion:
    return ModeCriterion(
        name=name, measured=measured, limit=f"< {limit:g}", passed=measured < limit
    )
