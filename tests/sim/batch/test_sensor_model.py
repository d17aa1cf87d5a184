"""The bias of forces on a sensor's mesh."""

from pathlib import Path

import numpy as np
import pytest

from sim.batch.measured_bias import press_alone
from sim.batch.sensor_model import Rim, bias_of, edge_of, sensor_model
from sim.coupling.gel_contact import UNMOVED, GelContact
from sim.scene.indenter import Sphere
from sim.scene.scene import Target
from sim.sensor.sensor import load_sensor
from tests.sim.batch.test_batch import GEL, PAD


def test_a_contact_as_wide_as_an_edge_is_more_off_than_a_wide_one() -> None:
    """Bias and what may remain fall as contacts grow, and with the mesh's edges."""
    coarse, fine = (sensor_model(PAD, GEL, edge_m=edge) for edge in (4e-3, 2e-3))
    area = np.pi * (np.array([1.0, 3.0]) * edge_of(coarse)) ** 2
    rims = np.full(2, Rim.ROUND)
    narrow = area**-0.75
    (bias, left), (finer, finer_left) = (
        (each.constant + each.slope * narrow, each.constant_left + each.slope_left * narrow)
        for each in (bias_of(coarse, rims), bias_of(fine, rims))
    )
    assert bias[0] > bias[1]
    assert left[0] > left[1]
    assert (finer_left < left).all()
    assert abs(finer[1]) < abs(bias[1])


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_measured_bias_is_kept_and_leaves_a_coupled_press_within_a_hundredth_of_one_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """F_z beside the middle is that of a press on its own mesh; a second start presses nothing."""
    ball, gel = Sphere(diameter_m=8e-3), load_sensor("gelsight-mini")
    scene = gel.scene(ball, Target(depth_m=0.8e-3))
    force_n, pose = press_alone(scene, np.array([1.3e-3, -2.1e-3]), np.array([0.0, 0.0, 0.0, 1.0]))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    wrenches = []
    for _ in range(2):
        contact = GelContact(ball, count=1, edge_m=1.25e-3, measures_bias=True, friction=0.0)
        contact.pads.frames.assign([UNMOVED])
        contact.objects.frames.assign([pose])
        contact.press()
        wrenches.append(contact.wrench.numpy()[0, 2])
        assert contact.force_error.numpy()[0] < 0.06
        monkeypatch.delattr("sim.batch.measured_bias.press_alone", raising=False)
    assert wrenches[0] == pytest.approx(force_n, rel=0.01)
    assert wrenches[1] == wrenches[0]
