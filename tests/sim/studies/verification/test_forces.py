"""Forces against solutions and measurements, and their orders of convergence."""

import numpy as np
import pytest

from sim.press import press
from sim.press_arguments import scene_from
from sim.scene.scene import ContactMode, Preset
from sim.studies import from_file
from sim.studies.verification import forces

STATED = from_file("verification/presses.toml")
PUNCH = STATED["punch"][0]
SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    ("preset", "punch", "allowed"),
    [
        (Preset.FAST, PUNCH, 0.05),
        pytest.param(Preset.BALANCED, STATED["punch"][-1], 0.035, marks=SLOW),
    ],
)
def test_punch_states_error_and_limit_of_each_row(
    preset: Preset, punch: dict[str, object], allowed: float
) -> None:
    """A row's error is that of its forces, and the verdict is whether all are within limits."""
    found = forces.measure_punch(preset=preset, stated=[{**punch, "allowed": allowed}])
    _, _, force, exact, error, limit = found.rows[0]
    assert isinstance(force, float)
    assert isinstance(exact, float)
    assert error == pytest.approx(100.0 * (force / exact - 1.0))
    assert limit == pytest.approx(100.0 * allowed)
    assert found.passed


def test_a_limit_that_is_not_met_is_missed() -> None:
    """The verdict follows the numbers."""
    assert not forces.measure_punch(preset=Preset.FAST, stated=[{**PUNCH, "allowed": 1e-9}]).passed


def test_ball_is_compared_with_hertz_where_the_pad_is_thick() -> None:
    """Thick: Hertz and layer are near each other; thin: the layer alone is to be met."""
    stated = STATED["ball"]
    found = forces.measure_ball(preset=Preset.FAST, stated=[stated[1], stated[3]])
    thick, thin = found.rows
    assert abs(float(thick[4] or 0.0) / float(thick[6] or 1.0) - 1.0) < 0.02
    assert abs(float(thin[5] or 0.0)) > 5.0
    assert abs(float(thin[7] or 100.0)) < 5.0
    result = press(scene_from(f"{stated[1]['press']} --preset balanced"))
    hertz_m = np.sqrt(1e-3 * result.depth_m)  # a ball of 2 mm
    assert result.contact_radius_m == pytest.approx(hertz_m, rel=0.1)


@pytest.mark.parametrize("order", [1.0, 1.8, 3.0])
def test_fit_finds_the_order_and_the_limit(order: float) -> None:
    """Forces on a power law give its power back."""
    edges = np.array([2.0, 1.333, 1.0, 0.667, 0.5])
    found, limit = forces.fitted_order(edges, 1.2 + 0.05 * edges**order)
    assert found == pytest.approx(order, abs=0.02)
    assert limit == pytest.approx(1.2, rel=2e-3)


@pytest.mark.parametrize(
    ("preset", "depth_max_m", "most_percent"),
    [(Preset.FAST, 0.1e-3, 5.0), pytest.param(Preset.BALANCED, 0.5e-3, 3.0, marks=SLOW)],
)
def test_disc_presses_both_laws_through_the_depths(
    preset: Preset, depth_max_m: float, most_percent: float
) -> None:
    """Forces at finite strain come near another program's; each law has its own rows."""
    found = forces.measure_disc(preset=preset, depth_max_m=depth_max_m)
    assert [row[:2] for row in found.rows[:2]] == [("neo-hookean", 0.05), ("neo-hookean", 0.1)]
    assert found.rows[-1][:2] == ("stable-neo-hookean", 1e3 * depth_max_m)
    assert all(abs(float(row[4] or 0.0)) < most_percent for row in found.rows)


def test_fitted_modulus_gives_the_measured_force() -> None:
    """A force at given depth is proportional to E."""
    asked = (0.48, ContactMode.FRICTIONLESS, Preset.FAST)
    young = forces.fitted_young(*asked)
    force = press(scene_from(forces.real_words(young, *asked))).force_n[2]
    assert force == pytest.approx(forces.REAL["force_n"], rel=1e-6)
    assert 0.4e6 < young < 0.6e6
