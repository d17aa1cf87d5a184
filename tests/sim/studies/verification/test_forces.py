"""Forces against solutions and measurements, and their orders of convergence."""

from __future__ import annotations

import numpy as np
import pytest

from sim.press import press
from sim.press_command import scene_from
from sim.scene.scene import ContactMode, Preset
from sim.studies import from_file
from sim.studies.verification import forces

PUNCH = from_file("verification/presses.toml")["punch"][0]


def test_punch_states_error_and_limit_of_each_row() -> None:
    """A row's error is that of its forces, and the verdict is whether all are within limits."""
    found = forces.measure_punch(preset=Preset.FAST, stated=[{**PUNCH, "allowed": 0.05}])
    _, _, force, exact, error, limit = found.rows[0]
    assert isinstance(force, float)
    assert isinstance(exact, float)
    assert error == pytest.approx(100.0 * (force / exact - 1.0))
    assert limit == 5.0
    assert found.passed


def test_a_limit_that_is_not_met_is_missed() -> None:
    """The verdict follows the numbers."""
    assert not forces.measure_punch(preset=Preset.FAST, stated=[{**PUNCH, "allowed": 1e-9}]).passed


def test_ball_is_compared_with_hertz_where_the_pad_is_thick() -> None:
    """Thick: Hertz and layer are near each other; thin: the layer alone is to be met."""
    stated = from_file("verification/presses.toml")["ball"]
    found = forces.measure_ball(preset=Preset.FAST, stated=[stated[1], stated[3]])
    thick, thin = found.rows
    assert abs(float(thick[4] or 0.0) / float(thick[6] or 1.0) - 1.0) < 0.02
    assert abs(float(thin[5] or 0.0)) > 5.0
    assert abs(float(thin[7] or 100.0)) < 5.0


@pytest.mark.parametrize("order", [1.0, 1.8, 3.0])
def test_fit_finds_the_order_and_the_limit(order: float) -> None:
    """Forces on a power law give its power back."""
    edges = np.array([2.0, 1.333, 1.0, 0.667, 0.5])
    found, limit = forces.fitted_order(edges, 1.2 + 0.05 * edges**order)
    assert found == pytest.approx(order, abs=0.02)
    assert limit == pytest.approx(1.2, rel=2e-3)


def test_disc_presses_both_laws_through_the_depths() -> None:
    """On preset fast the forces come within 5 %; each law has its own rows."""
    found = forces.measure_disc(preset=Preset.FAST, depth_max_m=0.1e-3)
    assert [row[:2] for row in found.rows] == [
        (law, depth) for law in ("neo-hookean", "stable-neo-hookean") for depth in (0.05, 0.1)
    ]
    assert all(abs(float(row[4] or 0.0)) < 5.0 for row in found.rows)


def test_fitted_modulus_gives_the_measured_force() -> None:
    """A force at given depth is proportional to E."""
    asked = (0.48, ContactMode.FRICTIONLESS, Preset.FAST)
    young = forces.fitted_young(*asked)
    force = press(scene_from(forces.real_words(young, *asked))).force_n[2]
    assert force == pytest.approx(forces.REAL["force_n"], rel=1e-6)
    assert 0.4e6 < young < 0.6e6
