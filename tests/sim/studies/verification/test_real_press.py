"""The press of a real gel."""

from __future__ import annotations

import pytest

from sim.press import press
from sim.press_command import scene_from
from sim.scene.scene import ContactMode, Preset
from sim.studies.verification.forces import real_press


def test_fitted_modulus_gives_the_measured_force() -> None:
    """A force at given depth is proportional to E."""
    real, poisson = real_press(), 0.48
    young = real.fitted_young(poisson, ContactMode.FRICTIONLESS, Preset.FAST)
    words = real.words(young, poisson, ContactMode.FRICTIONLESS, Preset.FAST)
    assert press(scene_from(words)).force_n[2] == pytest.approx(real.force_n, rel=1e-6)
    assert 0.4e6 < young < 0.6e6
