"""Plans held against everything on: what is compared, and what a catalogue must hold."""

from __future__ import annotations

from dataclasses import replace

import pytest

from sim.effects.plan import plan_effects
from sim.scene.indenter import Sphere
from sim.scene.material import Material
from sim.scene.pad import DiscPad
from sim.scene.scene import ContactMode, Effect, Motion, Preset, Scene, Target
from sim.studies.effects_check.check import EFFECT_CASES, EffectCase, check_effects, everything_on

SMALL = Scene(
    pad=DiscPad(radius_m=6e-3, height_m=3e-3),
    material=Material(young_pa=4e5, poisson=0.48),
    indenter=Sphere(diameter_m=6e-3),
    target=Target(force_n=0.02),
    preset=Preset.FAST,
    contact=ContactMode.FRICTION,
    friction=0.5,
    tolerance=0.05,
)


def test_the_catalogue_differs_in_what_is_planned() -> None:
    """Every doubtful effect is on in one scene and off in another; names are unique."""
    cases = EFFECT_CASES
    assert len({case.name for case in cases}) == len(cases) >= 8
    plans = [plan_effects(case.scene) for case in cases]
    doubtful = set(Effect) - {Effect.SELF_CONTACT, Effect.IMAGE, Effect.SHADOW, Effect.MARKERS}
    for effect in doubtful:
        assert {plan.is_on(effect) for plan in plans} == {True, False}, effect


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({}, "no friction contact"),
        ({"contact": ContactMode.BONDED}, "no bonded contact"),
        ({"contact": ContactMode.FRICTIONLESS}, "goes to a depth"),
        (
            {
                "contact": ContactMode.FRICTIONLESS,
                "target": Target(depth_m=1e-4),
                "motion": Motion(shift_m=(1e-4, 0.0)),
            },
            "goes straight down and is not tilted",
        ),
    ],
)
def test_what_cannot_be_combined_is_named(changes: dict[str, object], why: str) -> None:
    """Inertia stays apart, and the reason is told; all else is on."""
    scene = replace(SMALL, **changes)  # type: ignore[arg-type]
    everything, apart = everything_on(scene)
    assert [effect for effect, _ in apart] == [Effect.INERTIA]
    assert why in apart[0][1]
    plan = plan_effects(everything)
    assert not plan.is_on(Effect.INERTIA)
    assert plan.is_on(Effect.GRAVITY)
    assert plan.is_on(Effect.FINITE_STRAIN)
    assert plan.is_on(Effect.LOCKING_FREE_ELEMENT)
    assert plan.is_on(Effect.FRICTION) is (scene.contact is ContactMode.FRICTION)


def test_a_scene_is_held_against_everything() -> None:
    """By force, depths are compared, and the whole pad shows that symmetry changes nothing."""
    check = check_effects(EffectCase(name="small", shows="a ball", scene=SMALL, whole=True))
    assert check.passed
    assert 0.0 < check.difference <= check.plan.tolerance
    assert {Effect.FRICTION, Effect.GRAVITY, Effect.SYMMETRY} <= set(check.added)
    assert check.full.node_count > 3 * check.planned.node_count
    assert check.full.force_n[2] == pytest.approx(0.02, rel=1e-6)
    kept = [omission.effect for omission in check.omissions]
    assert kept == [Effect.LOCKING_FREE_ELEMENT]
    assert check.omissions[0].measured > check.plan.tolerance
    assert not check.needless
    assert check.as_json()["full"]["depth_m"] != check.as_json()["planned"]["depth_m"]
