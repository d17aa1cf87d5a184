"""The emulated force follows the arm's pose through the emulated gel."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from drivers.emulators.force_sensor.source import PlantSource
from drivers.emulators.plant.force_channel import ForceChannel
from drivers.emulators.plant.gel.gel import Geometry, Plant
from drivers.emulators.plant.press_table import PressCase
from drivers.emulators.plant.truth import draw_truth
from drivers.emulators.shared_world import SharedWorld
from tacauchy_rig.run import Pose

SURFACE = (0.0, -0.4, 0.2)


def test_reading_is_the_plants_force_with_offset_and_noise(tmp_path: Path) -> None:
    """Free before any pose and above the gel; pressed, Fz rises by the true force."""
    truth = draw_truth(7)
    plant = Plant(truth, PressCase(poisson=truth.poisson), Geometry(surface=SURFACE))
    world = SharedWorld.create(tmp_path / "world")
    source = PlantSource(plant, ForceChannel(truth, start_ns=0), world)
    free = source.read(0)
    assert (free.force_true_n, free.depth_true_m) == (0.0, None)

    top_z = SURFACE[2] + truth.surface_error_m
    down = (0.0, math.pi, 0.0)
    pressed = Pose(position=(SURFACE[0], SURFACE[1], top_z - 4e-4), rotation_vector=down)
    world.publish(pressed, (0.0,) * 6, 0)
    force = source.read(10_000_000)
    assert force.depth_true_m == pytest.approx(4e-4, abs=1e-6)
    assert 1.0 < force.force_true_n < 5.0
    gain = force.reading[2] - truth.force_offset_n[2]
    assert gain == pytest.approx(force.force_true_n, abs=5 * truth.force_noise_n)
