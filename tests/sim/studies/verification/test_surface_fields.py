"""Fields of the surface, height maps and balance against their references."""

from dataclasses import replace

import numpy as np
import pytest

from sim.press_arguments import scene_from
from sim.scene.indenter import Sphere
from sim.scene.material import Material
from sim.scene.pad import DiscPad
from sim.scene.scene import Preset, Scene, Target
from sim.studies.verification.balance import TRACTION_GAPS, balanced_press, is_balanced
from sim.studies.verification.height_map import (
    ABOVE_INDENTER,
    ABOVE_LIMIT,
    LARGEST,
    LIMIT_M,
    RMS,
    height_map_row,
    is_kept,
    kept_heights,
)
from sim.studies.verification.surface_fields import (
    PRESSURES,
    asymmetry_relative,
    error_relative,
    measure_pressure,
    row_of,
)

RADII, ANGLES = np.linspace(0.01, 1.0, 50), np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)


def test_error_and_asymmetry_of_a_field_that_is_off_by_what_is_known() -> None:
    """One per cent more everywhere is an error of one per cent; three lobes are not round."""
    exact = 2.0 - RADII
    values = np.tile(1.01 * exact[:, None], (1, len(ANGLES)))
    assert error_relative(RADII, values, exact[:, None]) == pytest.approx(0.01)
    assert asymmetry_relative(values) < 1e-12
    lobes = values * (1.0 + 0.1 * np.cos(3.0 * ANGLES))
    assert asymmetry_relative(lobes) == pytest.approx(0.1 / 1.1, rel=1e-6)


@pytest.mark.slow
def test_pressures_are_met_on_balanced_and_their_order_is_told() -> None:
    """Balls and a punch; the coarser mesh is worse."""
    table = measure_pressure(presets=(Preset.BALANCED,))
    assert table.passed
    assert [row[0] for row in table.rows] == [case.name for case in PRESSURES]
    assert all(float(row[-1] or 0.0) > 0.9 for row in table.rows)


def test_a_coarse_mesh_misses_what_is_allowed() -> None:
    """Edges four times longer than preset balanced's: the table must not pass them."""
    case = PRESSURES[1]
    coarse = replace(scene_from(case.press), preset=Preset.BALANCED, refinement=0.25)
    _, met = row_of(case, coarse)
    assert not met


@pytest.mark.parametrize(
    ("name", "preset"),
    [("ball", Preset.FAST), pytest.param("edge", Preset.BALANCED, marks=pytest.mark.slow)],
)
def test_every_pixel_is_near_the_reference_and_none_above_the_indenter(
    name: str, preset: Preset
) -> None:
    """Of 76,800 pixels none is more than 10 um off; the cheapest preset that keeps it."""
    found = height_map_row(name, preset, reference=kept_heights(name))
    assert found[ABOVE_INDENTER] == 0
    assert float(found[LARGEST] or 0.0) < 1e6 * LIMIT_M
    assert float(found[RMS] or 0.0) < 0.2e6 * LIMIT_M
    assert is_kept(found)


def test_a_map_of_another_body_is_far_off() -> None:
    """The comparison can fail: a ball's map is no edge's."""
    found = height_map_row("ball", Preset.FAST, reference=kept_heights("edge"))
    assert float(found[ABOVE_LIMIT] or 0.0) > 1000
    assert not is_kept(found)


SCENE = Scene(
    pad=DiscPad(radius_m=5e-3, height_m=3e-3),
    material=Material(young_pa=3e5, poisson=0.46),
    indenter=Sphere(diameter_m=5e-3),
    target=Target(depth_m=0.05e-3),
    preset=Preset.FAST,
)


def test_forces_agree_and_stress_follows() -> None:
    """Base, load and indenter agree to 1e-6; the surface's stress carries the force roughly."""
    scene = replace(SCENE, target=Target(force_n=0.01))
    found = balanced_press(scene)
    assert is_balanced(found)
    assert 0.0 < max(found[name] or 0.0 for name in TRACTION_GAPS) < 0.1
