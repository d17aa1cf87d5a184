"""The comparison of fields with exact ones: what it samples and that it sees a wrong field."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim.press_command import scene_from
from sim.scene.scene import Preset
from sim.studies.verification.surface_fields import CASES, RoundField, measure_pressure, row_of

RADII, ANGLES = np.linspace(0.01, 1.0, 50), np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)


def test_error_and_asymmetry_of_a_field_that_is_off_by_what_is_known() -> None:
    """One per cent more everywhere is an error of one per cent; three lobes are not round."""
    exact = 2.0 - RADII
    values = np.tile(1.01 * exact[:, None], (1, len(ANGLES)))
    even = RoundField(radii_m=RADII, angles_rad=ANGLES, values=values)
    assert even.error_relative(exact[:, None], within_m=0.8) == pytest.approx(0.01)
    assert even.asymmetry_relative(within_m=2.0) < 1e-12
    lobes = replace(even, values=values * (1.0 + 0.1 * np.cos(3.0 * ANGLES)))
    assert lobes.asymmetry_relative(within_m=2.0) == pytest.approx(0.1 / 1.1, rel=1e-6)


@pytest.mark.slow
def test_pressures_are_met_on_balanced_and_their_order_is_told() -> None:
    """Balls and a punch; the coarser mesh is worse."""
    table = measure_pressure(presets=(Preset.BALANCED,))
    assert table.passed
    assert [row[0] for row in table.rows] == [case.name for case in CASES[:3]]
    assert all(float(row[-1] or 0.0) > 0.9 for row in table.rows)


def test_a_coarse_mesh_misses_what_is_allowed() -> None:
    """Edges four times longer than preset balanced's: the table must not pass them."""
    case = CASES[1]
    coarse = replace(scene_from(case.words), preset=Preset.BALANCED, refinement=0.25)
    _, met = row_of(case, coarse)
    assert not met
