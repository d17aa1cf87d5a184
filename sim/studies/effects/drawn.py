"""Scenes drawn with a seed: whatever a press can be asked for, in ranges that presses reach."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from sim.effects.estimates import expected_force
from sim.scene.indenter import Cylinder, Indenter, Sphere, describe
from sim.scene.material import Layer, Material, RelaxationTerm
from sim.scene.pad import BoxPad
from sim.scene.scene import ContactMode, Motion, Output, Preset, Scene, Target

# Shares of scenes that have something, or are unlike the plainest.
_FRICTIONLESS, _BONDED = 0.35, 0.05
_BALL, _SHARP = 0.55, 0.15
_FORCED, _OFF_CENTRE, _MOVED, _TILTED = 0.25, 0.3, 0.25, 0.2
_LAYERED, _LOSSY, _ASKED, _FAST = 0.2, 0.3, 0.4, 0.8
# Ranges: logarithmic ones are of sizes, even ones of shares.
_HEIGHT_M, _HALF_M = (2e-3, 8e-3), (9e-3, 13e-3)
_YOUNG_PA, _POISSON = (0.03e6, 1e6), (0.3, 0.499)
_DEPTH_SHARE, _FRICTION = (0.01, 0.5), (0.05, 1.2)
_BALL_M, _PUNCH_M, _FILLET_SHARE = (3e-3, 20e-3), (2e-3, 8e-3), (0.05, 0.3)
_OFFSET_M, _SHIFT_M = (0.1e-3, 2e-3), (0.02e-3, 0.4e-3)
_TWIST_RAD, _TILT_RAD = (0.005, 0.15), (0.002, 0.05)
_DURATION_S = (2e-3, 60.0)
_TERM_SHARE, _TERM_S = (0.03, 0.3), (0.01, 100.0)
_SKIN_SHARE, _SKIN_STIFFNESS = (0.05, 0.4), (0.2, 10.0)
_TOLERANCE = (0.01, 0.1)
# Of a ball's radius: no deeper, as its side would overhang.
_BALL_DEPTH = 0.8


def drawn_scene(seed: int, number: int) -> Scene:
    """Return a scene, always the same for a seed and a number."""
    rng = np.random.default_rng([seed, number])
    height = _log(rng, _HEIGHT_M)
    half_x, half_y = (rng.uniform(*_HALF_M) for _ in range(2))
    indenter = _indenter(rng)
    depth = _log(rng, _DEPTH_SHARE) * height
    if isinstance(indenter, Sphere):
        depth = min(depth, _BALL_DEPTH * indenter.radius_m)
    contact, friction = _contact(rng)
    motion = _motion(rng, indenter, can_slide=contact is not ContactMode.BONDED)
    material = _material(rng)
    layers = _layers(rng, material)
    scene = Scene(
        pad=BoxPad(size_x_m=2.0 * half_x, size_y_m=2.0 * half_y, height_m=height),
        material=layers[-1].material if layers else material,
        layers=layers,
        indenter=indenter,
        target=Target(depth_m=depth),
        centre_m=_offset(rng, _OFF_CENTRE, _OFFSET_M),
        contact=contact,
        friction=friction,
        motion=motion,
        duration_s=_log(rng, _DURATION_S),
        outputs=frozenset(output for output in Output if rng.random() < _ASKED),
        tolerance=_log(rng, _TOLERANCE),
        preset=Preset.FAST if rng.random() < _FAST else Preset.BALANCED,
    )
    if rng.random() >= _FORCED:
        return scene
    return replace(scene, target=Target(force_n=expected_force(scene)))


def described(scene: Scene) -> str:
    """Return what was drawn in a few words."""
    target, motion, height = scene.target, scene.motion, scene.pad.height_m
    goal = f"{target.force_n:.3g} N" if target.depth_m is None else f"{target.depth_m / height:.0%}"
    friction = f" {scene.friction:.2g}" if scene.contact is ContactMode.FRICTION else ""
    extras = {
        "layered": scene.layers,
        "relaxing": scene.material.relaxation,
        "off centre": any(scene.centre_m),
        "slid": any(motion.shift_m),
        "twisted": motion.twist_rad,
        "tilted": any(motion.tilt_rad),
    }
    return ", ".join(
        (
            scene.preset.value,
            describe(scene.indenter),
            f"to {goal} of {height * 1e3:.2g} mm",
            f"nu {scene.material.poisson:.3g}",
            f"{scene.contact.value}{friction}",
            f"in {scene.duration_s:.2g} s",
            *(name for name, present in extras.items() if present),
        )
    )


def _indenter(rng: np.random.Generator) -> Indenter:
    if rng.random() < _BALL:
        return Sphere(diameter_m=_log(rng, _BALL_M))
    diameter = _log(rng, _PUNCH_M)
    fillet = 0.0 if rng.random() < _SHARP else 0.5 * rng.uniform(*_FILLET_SHARE) * diameter
    return Cylinder(diameter_m=diameter, fillet_m=fillet)


def _contact(rng: np.random.Generator) -> tuple[ContactMode, float]:
    kind, friction = rng.random(), rng.uniform(*_FRICTION)
    if kind < _FRICTIONLESS:
        return ContactMode.FRICTIONLESS, 0.0
    if kind < _FRICTIONLESS + _BONDED:
        return ContactMode.BONDED, 0.0
    return ContactMode.FRICTION, friction


def _motion(rng: np.random.Generator, indenter: Indenter, *, can_slide: bool) -> Motion:
    tilt = (0.0, 0.0)
    if isinstance(indenter, Cylinder):
        tilt = _offset(rng, _TILTED, _TILT_RAD)
    if not can_slide or rng.random() >= _MOVED:
        return Motion(tilt_rad=tilt)
    if rng.random() < 0.3:
        return Motion(twist_rad=_log(rng, _TWIST_RAD), tilt_rad=tilt)
    return Motion(shift_m=_offset(rng, 1.0, _SHIFT_M), tilt_rad=tilt)


def _offset(
    rng: np.random.Generator, share: float, sizes: tuple[float, float]
) -> tuple[float, float]:
    """Return two numbers: none, or one along x, y or both."""
    if rng.random() >= share:
        return 0.0, 0.0
    size, way = _log(rng, sizes), rng.integers(3)
    if way == 2:
        angle = rng.uniform(0.0, 2.0 * math.pi)
        return size * math.cos(angle), size * math.sin(angle)
    return (size, 0.0) if way == 0 else (0.0, size)


def _material(rng: np.random.Generator) -> Material:
    terms: tuple[RelaxationTerm, ...] = ()
    if rng.random() < _LOSSY:
        count = rng.integers(1, 3)
        terms = tuple(
            RelaxationTerm(share=_log(rng, _TERM_SHARE), time_s=_log(rng, _TERM_S))
            for _ in range(count)
        )
    return Material(young_pa=_log(rng, _YOUNG_PA), poisson=rng.uniform(*_POISSON), relaxation=terms)


def _layers(rng: np.random.Generator, base: Material) -> tuple[Layer, ...]:
    if rng.random() >= _LAYERED:
        return ()
    skin = Material(
        young_pa=_log(rng, _SKIN_STIFFNESS) * base.young_pa,
        poisson=rng.uniform(*_POISSON),
        relaxation=base.relaxation,
    )
    share = _log(rng, _SKIN_SHARE)
    return (Layer(share=1.0 - share, material=base), Layer(share=share, material=skin))


def _log(rng: np.random.Generator, span: tuple[float, float]) -> float:
    """Return a size: its logarithm is evenly distributed."""
    low, high = span
    return math.exp(rng.uniform(math.log(low), math.log(high)))
