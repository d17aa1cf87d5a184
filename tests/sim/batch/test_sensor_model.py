"""The bias of forces on a sensor's mesh."""

from pathlib import Path

import numpy as np
import pytest

from sim.batch.batch import Batch
from sim.batch.contact_inverse import ContactInverse
from sim.batch.force_bias import press_alone
from sim.batch.sensor_model import bias_of, pressure_form, sensor_model
from sim.coupling.rigid_body_contact import UNMOVED, GelContact
from sim.scene.indenter import Sphere
from sim.scene.scene import Target
from sim.sensor.sensor import load_sensor
from tests.sim.batch.test_batch import GEL, PAD


def test_only_pressure_that_changes_within_faces_makes_the_mesh_too_stiff() -> None:
    """Under linear pressure contact gives way too much, under that at one point too little."""
    model = sensor_model(PAD, GEL, edge_m=4e-3)
    form, corners = pressure_form(model), model.reference.face_points
    weights = model.reference.face_weights
    assert (np.einsum("qk,q,qr,rk->k", corners, weights, form, corners) < 0.0).all()
    assert form[0, 0] > 0.0


def test_bias_and_what_remains_fall_with_the_edges() -> None:
    """Each of their terms does."""
    models = (sensor_model(PAD, GEL, edge_m=edge) for edge in (4e-3, 2e-3))
    one = {"count": 1, "young_share": np.ones(1)}
    coarse, fine = (bias_of(model, ContactInverse(model, **one)) for model in models)
    assert (fine.known[0, :2] < coarse.known[0, :2]).all()
    assert (fine.left < coarse.left).all()


def test_a_light_contact_has_its_force_wherever_it_touches() -> None:
    """A ball on one to five points: Hertz's force, stiffened by the base (Dimitriadis)."""
    depth, radius, places = 0.08e-3, 2e-3, np.random.default_rng(7).uniform(-1e-3, 1e-3, (12, 2))
    poses = np.tile([0.0, 0.0, PAD.height_m - depth, 0.0, 0.0, 0.0, 1.0], (12, 1))
    poses[:, :2] = places
    model = sensor_model(PAD, GEL, edge_m=2e-3)
    found = Batch(model, [Sphere(diameter_m=2 * radius)], [0] * 12).step(poses)
    chi, modulus = np.sqrt(radius * depth) / PAD.height_m, GEL.young_pa / (1 - GEL.poisson**2)
    hertz_n = 4 / 3 * modulus * chi * PAD.height_m * depth * (1 + 1.133 * chi + 1.283 * chi**2)
    assert np.abs(found.wrench[:, 2] / hertz_n - 1).max() < 0.05 < found.force_error.min()
    assert np.ptp(found.raw_wrench[:, 2]) > 0.3 * hertz_n


def test_shear_under_sticking_points_adds_to_the_bias() -> None:
    """The same ball at the same depth: the mesh adds more force with friction than without."""
    model = sensor_model(PAD, GEL, edge_m=2e-3, friction=1.0)
    batch = Batch(model, [Sphere(diameter_m=8e-3)], [0, 0], friction=np.array([0.0, 0.9]))
    found = batch.step(np.tile([0.0, 0.0, PAD.height_m - 0.5e-3, 0.0, 0.0, 0.0, 1.0], (2, 1)))
    smooth, rough = found.raw_wrench[:, 2] / found.wrench[:, 2]
    assert rough > smooth + 0.03


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
        monkeypatch.delattr("sim.batch.force_bias.press_alone", raising=False)
    assert wrenches[0] == pytest.approx(force_n, rel=0.01)
    assert wrenches[1] == wrenches[0]
