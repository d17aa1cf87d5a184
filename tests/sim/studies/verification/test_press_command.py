"""Scenes as commands."""

from __future__ import annotations

from dataclasses import replace

import pytest

from sim.scene.material import LawName
from sim.scene.pad import BoxPad
from sim.scene.scene import Preset
from sim.studies.verification.disc import disc_scene
from sim.studies.verification.press_command import press_command
from tacauchy_rig.errors import ConfigError

SCENE = disc_scene(LawName.NEO_HOOKEAN, 0.05e-3, Preset.FAST)


def test_command_states_the_scene() -> None:
    """Pad, indenter, target, material, law, contact and preset, as the command line takes them."""
    assert press_command(SCENE) == (
        "tacauchy-rig press --pad disc:radius=12mm,height=4.5mm --indenter cylinder:diameter=5mm "
        "--depth 0.05mm --young 0.3MPa --poisson 0.45 --law neo-hookean --contact bonded "
        "--preset fast"
    )


def test_command_refuses_a_pad_that_it_cannot_write() -> None:
    """Rather than a command that presses something else."""
    pad = BoxPad(size_x_m=20e-3, size_y_m=25e-3, height_m=4e-3)
    with pytest.raises(ConfigError, match="neither a sensor nor a disc"):
        press_command(replace(SCENE, pad=pad))
