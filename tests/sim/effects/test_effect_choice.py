"""The plan: what is left out changes F_z by less than was said, and is not launched."""

from dataclasses import replace

import numpy as np
import pytest

from sim.contact import surface_and_grip as contact_surface
from sim.contact.barrier_and_friction_kernels import contact_kernels
from sim.effects import depth_and_inertia_scales as estimates
from sim.effects.effect_choice import plan_effects
from sim.press import press
from sim.press_arguments import scene_from
from sim.scene.indenter import Cylinder, Indenter, Sphere
from sim.scene.material import LawName, Layer, Material, RelaxationTerm
from sim.scene.pad import BoxPad, DiscPad
from sim.scene.scene import ContactMode, Effect, Motion, Output, Preset, Scene, Target
from sim.sensor.sensor import load_sensor
from tacauchy_rig.core.errors import ConfigError

GEL = Material(young_pa=4e5, poisson=0.48)
PAD = DiscPad(radius_m=8e-3, height_m=4e-3)
PUNCH = Cylinder(diameter_m=5e-3, fillet_m=0.2e-3)
BALL = Sphere(diameter_m=10e-3)


def scene(indenter: Indenter = BALL, *, depth_m: float = 0.1e-3, material: Material = GEL) -> Scene:
    """Return a shallow press on the coarsest mesh."""
    return Scene(
        pad=PAD,
        material=material,
        indenter=indenter,
        target=Target(depth_m=depth_m),
        preset=Preset.FAST,
    )


WHOLE = ((Effect.SYMMETRY, False),)
RUBBED = replace(scene(), contact=ContactMode.FRICTION, friction=0.1)
SCENES = {
    "shallow ball": (scene(), {Effect.GRAVITY, Effect.INERTIA}),
    "ball with friction": (RUBBED, {Effect.FRICTION, Effect.GRAVITY}),
    "heavy gel": (
        scene(material=replace(GEL, young_pa=2e4, density_kg_m3=1500.0)),
        {Effect.GRAVITY},
    ),
    "gel that has relaxed": (
        replace(
            scene(material=replace(GEL, relaxation=(RelaxationTerm(share=0.2, time_s=1e-4),))),
            preset=Preset.ACCURATE,
            refinement=0.4,
            contact=ContactMode.FRICTION,
            friction=0.0,
        ),
        {Effect.VISCOELASTICITY},
    ),
}


@pytest.mark.parametrize("name", SCENES)
def test_what_is_left_out_costs_no_more_than_was_said(name: str) -> None:
    """F_z under the plan against F_z with everything that was left out switched on."""
    planned_scene, doubtful = SCENES[name]
    plan = plan_effects(planned_scene)
    assert not any(plan.is_on(effect) for effect in doubtful)
    kept = {Effect.INERTIA: False} if planned_scene.friction == 0.1 else {}
    switched = dict.fromkeys(doubtful, True) | kept
    everything = replace(planned_scene, effects=tuple(switched.items()))
    planned, full = press(planned_scene).force_n[2], press(everything).force_n[2]
    assert planned != full
    assert planned == pytest.approx(full, rel=plan.estimated_error)
    assert plan.estimated_error <= plan.tolerances[Output.FORCE]


BIG = load_sensor("gelsight-mini").scene(
    Sphere(diameter_m=15e-3),
    Target(depth_m=1e-3),
    contact=ContactMode.FRICTION,
    friction=1.0,
    preset=Preset.FAST,
)


@pytest.mark.parametrize(("depth_m", "least"), [(1e-3, 0.09), (2e-3, 0.28)])
def test_a_large_ball_keeps_its_friction(depth_m: float, least: float) -> None:
    """Friction 1.0 is worth 9 and 28 % of F_z, and the plan says no less."""
    plan = plan_effects(replace(BIG, target=Target(depth_m=depth_m)))
    row = plan.rows[Effect.FRICTION]
    assert row.on
    assert row.costs is not None
    assert row.costs[Output.FORCE] >= least
    assert plan.tried_s > 0.0


def test_what_is_left_out_adds_up() -> None:
    """Each alone would do, both together would not: one stays on."""
    alone = plan_effects(RUBBED)
    costs = {row.effect: row.estimated_error or 0.0 for row in alone.rows.values() if not row.on}
    both = costs[Effect.FRICTION] + costs[Effect.GRAVITY] + costs[Effect.INERTIA]
    tight = plan_effects(replace(RUBBED, tolerance=0.99 * both))
    assert max(costs.values()) <= 0.99 * both
    assert tight.is_on(Effect.FRICTION)
    assert not tight.is_on(Effect.GRAVITY)


@pytest.mark.parametrize("output", [Output.SHEAR, Output.MARKERS])
def test_friction_stays_where_what_it_makes_is_asked_for(output: Output) -> None:
    """A ball pressed straight loses its shear and marker motion without friction."""
    rubbed = replace(RUBBED, friction=0.5)
    assert not plan_effects(rubbed).is_on(Effect.FRICTION)
    assert plan_effects(replace(rubbed, outputs=frozenset({output}))).is_on(Effect.FRICTION)
    loose = replace(rubbed, output_tolerances=((output, 2.0),))
    assert not plan_effects(loose).is_on(Effect.FRICTION)


def test_nothing_is_left_out_where_a_press_has_several_equilibria() -> None:
    """Inertia and weight choose between the folds at a deep sharp rim, if 2 % are asked for."""
    folded = scene(Cylinder(diameter_m=5e-3), depth_m=1.8e-3)
    plan = plan_effects(replace(folded, tolerance=0.02))
    for effect in (Effect.INERTIA, Effect.GRAVITY):
        assert plan.is_on(effect)
        assert "on untried: a sharp rim" in plan.rows[effect].reason
        assert not plan_effects(replace(folded, tolerance=0.03)).is_on(effect)


def test_trying_that_cannot_pay_is_left() -> None:
    """On preset fast a coarse press costs more than weight, and on preset paper there is none."""
    lossy = replace(GEL, relaxation=(RelaxationTerm(share=0.2, time_s=1e-4),))
    plan = plan_effects(scene(material=lossy))
    row = plan.rows[Effect.VISCOELASTICITY]
    assert row.on
    assert "on untried: trying costs" in row.reason
    assert plan.tried_s == 0.0
    paper = plan_effects(replace(RUBBED, preset=Preset.PAPER))
    assert paper.is_on(Effect.FRICTION)


@pytest.mark.parametrize(
    ("changes", "effect", "on"),
    [
        ({"duration_s": 3e-4}, Effect.INERTIA, True),
        ({"duration_s": 3e-2}, Effect.INERTIA, False),
        ({"target": Target(depth_m=1e-3)}, Effect.FINITE_STRAIN, True),
        ({"material": replace(GEL, law=LawName.LINEAR)}, Effect.FINITE_STRAIN, False),
        ({"material": replace(GEL, law=LawName.PAPER_EQ4)}, Effect.FINITE_STRAIN, True),
        ({"target": Target(force_n=4.7)}, Effect.FINITE_STRAIN, True),
        (
            {"contact": ContactMode.FRICTION, "friction": 0.5, "tolerance": 1e-3},
            Effect.FRICTION,
            True,
        ),
        (
            {
                "contact": ContactMode.FRICTION,
                "friction": 0.5,
                "motion": Motion(shift_m=(1e-4, 0.0)),
            },
            Effect.FRICTION,
            True,
        ),
        ({"motion": Motion(twist_rad=0.1)}, Effect.SYMMETRY, False),
        ({"motion": Motion(tilt_rad=(0.01, 0.01)), "indenter": PUNCH}, Effect.SYMMETRY, False),
        ({"centre_m": (1e-3, 1e-3)}, Effect.SYMMETRY, False),
        ({}, Effect.SYMMETRY, True),
        ({}, Effect.LOCKING_FREE_ELEMENT, True),
        ({"preset": Preset.PAPER}, Effect.LOCKING_FREE_ELEMENT, False),
        (
            {"layers": (Layer(share=0.5, material=GEL), Layer(share=0.5, material=GEL))},
            Effect.SECOND_LAYER,
            True,
        ),
        ({}, Effect.SELF_CONTACT, False),
    ],
)
def test_a_scene_gets_what_it_calls_for(
    changes: dict[str, object], effect: Effect, on: bool
) -> None:
    """Scenes that differ in one thing differ in its effect."""
    changed = replace(scene(), **changes)  # type: ignore[arg-type]
    row = plan_effects(changed).rows[effect]
    assert row.on is on
    assert row.reason


def test_what_is_off_is_not_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Friction, relaxation and their memory exist only in a press that has them."""
    asked: set[bool] = set()

    def noted(*, grips: bool) -> object:
        asked.add(grips)
        return contact_kernels(grips=grips)

    plan_effects(RUBBED)  # its trials rub; a plan is remembered, so that the press asks for its own
    monkeypatch.setattr(contact_surface, "contact_kernels", noted)
    result = press(RUBBED)
    assert asked == {False}
    assert result.point.state.grip is None
    assert result.model.relaxation is None
    asked.clear()
    press(replace(RUBBED, effects=((Effect.FRICTION, True),)))
    assert asked == {True}


@pytest.mark.parametrize(
    ("changes", "copies"),
    [
        ({"indenter": PUNCH}, 4),
        ({"motion": Motion(tilt_rad=(0.0, 0.01)), "indenter": PUNCH}, 2),
        ({"motion": Motion(shift_m=(0.0, 2e-5)), "contact": ContactMode.FRICTION}, 2),
        pytest.param({"centre_m": (1e-3, 0.0)}, 2, marks=pytest.mark.slow),
    ],
    ids=["centred", "tilted", "sliding", "off centre"],
)
def test_a_part_gives_what_the_whole_does(changes: dict[str, object], copies: int) -> None:
    """Force and moment, where planes mirror pad, indenter and motion."""
    asked = replace(scene(), **changes)  # type: ignore[arg-type]
    part, whole = press(asked), press(replace(asked, effects=WHOLE))
    assert copies * part.tet_count == whole.tet_count
    # Preset fast leaves 1e-6 of the contact force unbalanced, and lagged friction 1e-4 of it.
    size = np.linalg.norm(whole.force_n)
    np.testing.assert_allclose(part.force_n, whole.force_n, atol=1e-4 * size)
    np.testing.assert_allclose(part.moment_nm, whole.moment_nm, atol=1e-4 * size * 1e-3)


def test_what_cannot_be_added_is_refused() -> None:
    """Self-contact is not simulated, and says so."""
    with pytest.raises(ConfigError, match="gel against gel is not simulated"):
        plan_effects(replace(scene(), effects=((Effect.SELF_CONTACT, True),)))


def test_a_quick_press_is_stepped_in_time() -> None:
    """Inertia that is called for is simulated: the gel pushes back with its mass as well."""
    slow, quick = press(scene()), press(replace(scene(), duration_s=3e-4))
    # Where preset fast stops: 1e-6 of the modelled quarter's force, which leans by 0.3 %.
    assert slow.force_balance_relative < 1.01e-6
    assert quick.force_balance_relative > 1e-3
    assert quick.force_n[2] != pytest.approx(slow.force_n[2], rel=1e-3)
    by_force = press(replace(scene(), duration_s=3e-4, target=Target(force_n=0.1)))
    assert by_force.force_n[2] == pytest.approx(0.1, rel=1e-6)


SCENE = scene_from(
    "--pad box:20x25x4mm --young 0.4MPa --poisson 0.45 "
    "--indenter cylinder:diameter=5mm,fillet=0.2mm --depth 0.5mm"
)
SOFT = SCENE.material


@pytest.mark.parametrize(
    "indenter", [Cylinder(diameter_m=5e-3), Sphere(diameter_m=8e-3)], ids=["punch", "ball"]
)
def test_depth_and_force_are_each_others_inverse(indenter: Indenter) -> None:
    """The force expected at a depth leads back to the depth."""
    scene = replace(SCENE, indenter=indenter)
    force = estimates.expected_force(scene)
    assert force > 0.0
    back = estimates.expected_depth(replace(scene, target=Target(force_n=force)))
    assert back == pytest.approx(0.5e-3, rel=1e-9)


def test_expected_force_of_a_punch_is_the_half_spaces_on_a_thick_gel() -> None:
    """2 a E d / (1 - nu^2) where the gel is much thicker than the punch is wide."""
    thick = replace(SCENE, pad=BoxPad(size_x_m=9.0, size_y_m=9.0, height_m=5.0))
    half_space = 2.0 * 2.5e-3 * SOFT.young_pa * 0.5e-3 / (1.0 - SOFT.poisson**2)
    assert estimates.expected_force(thick) == pytest.approx(half_space, rel=1e-3)


def test_inertia_and_gravity_scale_as_they_must() -> None:
    """(T1 / t)^2, and rho g H / E of the softest."""
    once, twice = (
        estimates.inertia_error(replace(SCENE, duration_s=k * SCENE.duration_s)) for k in (1, 2)
    )
    assert once is not None
    assert twice == pytest.approx(0.25 * once)
    assert estimates.weight_scale(SCENE) == pytest.approx(1e3 * 9.81 * 4e-3 / 0.4e6)


def test_beyond_their_ranges_scales_say_nothing() -> None:
    """A press as quick as the pad rings, and a gel that flows."""
    quick = replace(SCENE, duration_s=2.0 * estimates.slowest_period(SCENE))
    assert estimates.inertia_error(quick) is None
    soft = replace(SCENE, material=replace(SOFT, young_pa=1e3))
    assert estimates.gravity_error(soft) is None


@pytest.mark.parametrize(
    ("share", "fillet_m", "several"), [(0.3, 0.0, True), (0.2, 0.0, False), (0.3, 0.2e-3, False)]
)
def test_a_deep_sharp_rim_has_several_equilibria(
    share: float, fillet_m: float, several: bool
) -> None:
    """Its faces fold at the rim; shallow ones and rounded ones do not."""
    indenter = Cylinder(diameter_m=5e-3, fillet_m=fillet_m)
    target = Target(depth_m=share * SCENE.pad.height_m)
    scene = replace(SCENE, indenter=indenter, target=target)
    assert estimates.has_several_equilibria(scene) is several


@pytest.mark.parametrize(("skin_pa", "several"), [(0.1e6, True), (1e6, False)])
def test_a_sharp_rim_folds_a_softer_skin_sooner(skin_pa: float, several: bool) -> None:
    """A skin of a tenth of the gel is folded at an eighth of it; a stiffer one is not."""
    skin = Layer(share=0.1, material=replace(SOFT, young_pa=skin_pa))
    scene = replace(
        SCENE,
        material=skin.material,
        layers=(Layer(share=0.9, material=SOFT), skin),
        indenter=Cylinder(diameter_m=5e-3),
        target=Target(depth_m=0.125 * SCENE.pad.height_m),
    )
    assert estimates.has_several_equilibria(scene) is several
