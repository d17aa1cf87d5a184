"""Sections on preset fast: what they hold, and that they can be missed."""

from __future__ import annotations

import pytest

from sim.press import press
from sim.scene.material import LawName
from sim.scene.scene import ContactMode, Preset
from sim.studies.verification import mesh_table, stress_cost
from sim.studies.verification.against_itself import drives
from sim.studies.verification.against_solutions import disc, hertz, punch, real_press
from sim.studies.verification.against_solutions.real_press import fitted_young, real_scene
from sim.studies.verification.catalogue import SECTIONS


def test_punch_states_error_and_limit_of_each_row() -> None:
    """A row's error is that of its forces, and the verdict is whether all are within limits."""
    found = punch.measure(preset=Preset.FAST, allowed=((0.45, 0.05),))
    _, _, force, exact, error, limit = found.rows[0]
    assert isinstance(force, float)
    assert isinstance(exact, float)
    assert error == pytest.approx(100.0 * (force / exact - 1.0))
    assert limit == 5.0
    assert found.passed


def test_a_limit_that_is_not_met_is_missed() -> None:
    """The verdict follows the numbers."""
    assert not punch.measure(preset=Preset.FAST, allowed=((0.45, 1e-9),)).passed


def test_disc_presses_both_laws_through_the_depths() -> None:
    """On preset fast the forces come within 5 %; each law has its own rows."""
    found = disc.measure(preset=Preset.FAST, depth_max_m=0.1e-3)
    assert [row[:2] for row in found.rows] == [
        (law, depth) for law in ("neo-hookean", "stable-neo-hookean") for depth in (0.05, 0.1)
    ]
    assert all(abs(float(row[4] or 0.0)) < 5.0 for row in found.rows)


def test_disc_reference_is_read_with_its_doubt() -> None:
    """The deepest row of the stable law, in SI."""
    deepest = disc.disc_forces()[-1]
    assert deepest.law is LawName.STABLE_NEO_HOOKEAN
    assert (deepest.depth_m, deepest.force_n) == (pytest.approx(0.5e-3), 1.83785)
    assert deepest.uncertainty_n < 0.01 * deepest.force_n


def test_ball_is_compared_with_hertz_where_the_pad_is_thick() -> None:
    """Thick: Hertz and layer are near each other; thin: the layer alone is to be met."""
    found = hertz.measure(preset=Preset.FAST, presses=((15e-3, 20e-6), (2e-3, 40e-6)))
    thick, thin = found.rows
    assert abs(float(thick[4] or 0.0) / float(thick[6] or 1.0) - 1.0) < 0.02
    assert abs(float(thin[5] or 0.0)) > 5.0
    assert abs(float(thin[7] or 100.0)) < 5.0


def test_fitted_modulus_gives_the_measured_force() -> None:
    """A force at given depth is proportional to E."""
    real, poisson = real_press.real_press(), 0.48
    young = fitted_young(real, poisson, ContactMode.FRICTIONLESS, Preset.FAST)
    scene = real_scene(real, young, poisson, ContactMode.FRICTIONLESS, Preset.FAST)
    assert press(scene).force_n[2] == pytest.approx(real.force_n, rel=1e-6)
    assert 0.4e6 < young < 0.6e6


def test_drives_agree_in_depth() -> None:
    """One small force, by load and by displacement."""
    found = drives.measure(preset=Preset.FAST, forces_n=(0.6,))
    assert found.passed
    assert found.rows[0][1] == pytest.approx(found.rows[0][2], rel=1e-3)


def test_stress_cost_is_reported_and_never_judged() -> None:
    """Quantiles rise; whatever they are, nothing is missed."""
    found = stress_cost.measure(presets=(Preset.PAPER,))
    low, middle, high = (float(value or 0.0) for value in found.rows[0][5:8])
    assert 0.0 < low <= middle <= high
    assert found.passed


def test_mesh_table_has_the_papers_numbers_beside_ours() -> None:
    """The refined mesh has more tetrahedra than the coarse one, and shorter edges."""
    rows = {row[0]: row[1:] for row in mesh_table.measure().rows}
    assert rows["tetrahedra, refined"][0] == 1920
    assert float(rows["refined over not refined"][1] or 0.0) > 1.0
    assert float(rows["density in the middle, refined over not"][1] or 0.0) > 1.0


def test_every_section_of_the_catalogue_has_a_name_of_the_command_line() -> None:
    """Names are what ``--sections`` takes: lower case and hyphens."""
    assert all(name.replace("-", "").isalpha() and name == name.lower() for name in SECTIONS)
