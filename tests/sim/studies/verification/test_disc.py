"""The clamped disc, on preset fast."""

from __future__ import annotations

import pytest

from sim.scene.material import LawName
from sim.scene.scene import Preset
from sim.studies.verification import forces


def test_disc_presses_both_laws_through_the_depths() -> None:
    """On preset fast the forces come within 5 %; each law has its own rows."""
    found = forces.measure_disc(preset=Preset.FAST, depth_max_m=0.1e-3)
    assert [row[:2] for row in found.rows] == [
        (law, depth) for law in ("neo-hookean", "stable-neo-hookean") for depth in (0.05, 0.1)
    ]
    assert all(abs(float(row[4] or 0.0)) < 5.0 for row in found.rows)


def test_disc_reference_is_read_with_its_doubt() -> None:
    """The deepest row of the stable law, in SI."""
    deepest = forces.disc_forces()[-1]
    assert deepest.law is LawName.STABLE_NEO_HOOKEAN
    assert (deepest.depth_m, deepest.force_n) == (pytest.approx(0.5e-3), 1.83785)
    assert deepest.uncertainty_n < 0.01 * deepest.force_n
