"""Images and markers of several gels at once, from the nodes of a model."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray

from sim.contact.surface_and_grip import State
from sim.device import Device
from sim.effects.presets import build_model
from sim.fields.saved_press import SurfaceState, surface_state
from sim.optics.height.height_map import height_maps
from sim.optics.markers.simulated_markers import marker_places, surface_displacement
from sim.optics.render.renderer import nominal_renderer
from sim.optics.surface_images import SurfaceImages
from sim.scene.indenter import (
    Cylinder,
    Indenter,
    IndenterSet,
    Sphere,
    cylinder_triangles,
    mesh_indenter,
    tilted,
)
from sim.scene.scene import Effect, Preset, Target
from sim.sensor.sensor import load_sensor
from sim.solve.model import Model
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError

_DEPTHS_M = (0.0, 0.2e-3, 0.5e-3)
_PUNCH = Cylinder(diameter_m=5e-3, fillet_m=0.3e-3)
_BALL = Sphere(diameter_m=8e-3)
_BODY = mesh_indenter(*cylinder_triangles(_PUNCH, sectors=24), name="punch")
_SAMPLES = 2
_TILT_RAD = (0.05, -0.03)


@cache
def _model(sensor: str, *effects_off: Effect, device: str = "cpu") -> Model:
    scene = load_sensor(sensor).scene(_PUNCH, Target(depth_m=_DEPTHS_M[-1]), preset=Preset.FAST)
    off = tuple((effect, False) for effect in effects_off)
    return build_model(replace(scene, effects=off), device=device)


def _pressed(model: Model) -> tuple[FloatArray, FloatArray]:
    """Return nodes, shape [3, node_count, 3], and tips: a dent with a steep skirt, and bulges."""
    rest, height_m = model.nodes, model.height_m
    radius = np.hypot(rest[:, 0], rest[:, 1])
    positions = np.repeat(rest[None], len(_DEPTHS_M), axis=0)
    for moved, depth in zip(positions, _DEPTHS_M, strict=True):
        dent = depth * rest[:, 2] / height_m / (1.0 + np.exp((radius - 2.7e-3) / 0.12e-3))
        moved[:, 2] -= dent
        moved[:, :2] *= 1.0 + 0.1 * dent[:, None] / height_m
    tips = np.array([[0.0, 0.0, height_m - depth] for depth in _DEPTHS_M])
    return positions, tips


def _surface(
    model: Model, positions: FloatArray, tip: FloatArray, indenter: Indenter, rotation: FloatArray
) -> SurfaceState:
    """Return one gel as a press hands it over."""
    state = State(positions=positions, tip=tip, rotation=rotation)
    path: Any = SimpleNamespace(model=model, indenter=indenter)
    point: Any = SimpleNamespace(state=state)
    return surface_state(path, point)


def _together(
    model: Model, sensor: str, indenter: Indenter, rotation: FloatArray
) -> tuple[SurfaceImages, list[Any]]:
    """Return what draws three gels, and what it takes: nodes, tips and rotations on the device."""
    device = Device(model.device)
    positions, tips = _pressed(model)
    turned = np.tile(rotation, (len(tips), 1, 1))
    drawing = SurfaceImages(model, indenter, load_sensor(sensor), count=len(tips), samples=_SAMPLES)
    vectors = [device.array(values, wp.vec3d) for values in (positions, tips)]
    return drawing, [*vectors, device.array(turned, wp.mat33d)]


@pytest.mark.parametrize(
    ("name", "off", "indenter", "tilt_rad"),
    [
        ("gelsight-mini", (), _PUNCH, (0.0, 0.0)),
        ("digit", (), _BALL, (0.0, 0.0)),
        ("9dtact", (), _PUNCH, (0.0, 0.0)),
        ("gelsight-mini", (Effect.LOCKING_FREE_ELEMENT,), _BALL, (0.0, 0.0)),
        ("digit", (Effect.SYMMETRY,), _PUNCH, _TILT_RAD),
        ("digit", (Effect.SYMMETRY,), _BODY, _TILT_RAD),
    ],
)
def test_batch_gives_the_single_images(
    name: str, off: tuple[Effect, ...], indenter: Indenter, tilt_rad: tuple[float, float]
) -> None:
    """Three gels side by side, of a quarter, a whole or a linear model, are drawn as one by one."""
    model, sensor, rotation = _model(name, *off), load_sensor(name), tilted(*tilt_rad)
    assert model.mesh.symmetry.copies == (1 if Effect.SYMMETRY in off else 4)
    drawing, taken = _together(model, name, indenter, rotation)
    images, markers = np.from_dlpack(drawing.images(*taken)), drawing.markers(taken[0]).numpy()
    geometry = sensor.camera
    assert images.shape == (3, geometry.height, geometry.width, 3)
    places = marker_places(sensor.markers) if sensor.markers else np.zeros((0, 2))
    render = nominal_renderer(sensor, samples=_SAMPLES)
    for env, (positions, tip) in enumerate(zip(*_pressed(model), strict=True)):
        surface = _surface(model, positions, tip, indenter, rotation)
        alone = render(height_maps(surface, geometry.refined(_SAMPLES), pad=sensor.pad))
        assert np.abs(images[env].astype(int) - alone.astype(int)).max() <= 1
        moved = places + surface_displacement(surface, places)[:, :2]
        np.testing.assert_allclose(markers[env], geometry.to_pixels(moved), atol=1e-4)
    dent = np.abs(images[2].astype(int) - images[0].astype(int)).max()
    assert dent > 10


def test_unmoved_gel_gives_the_frame_and_markers_at_rest() -> None:
    """Without contact the image is the no-contact frame, and markers are where they are printed."""
    model, sensor = _model("gelsight-mini"), load_sensor("gelsight-mini")
    assert sensor.markers is not None
    frame: NDArray[np.uint8] = np.random.default_rng(1).integers(
        90, 160, (sensor.camera.height, sensor.camera.width, 3), dtype=np.uint8
    )
    drawing = SurfaceImages(model, _PUNCH, sensor, count=1, background=frame)
    device = Device("cpu")
    nodes = device.array(model.nodes[None], wp.vec3d)
    above = device.array(np.array([[0.0, 0.0, 2.0 * model.height_m]]), wp.vec3d)
    np.testing.assert_array_equal(drawing.images(nodes, above).numpy()[0], frame)
    rest = sensor.camera.to_pixels(marker_places(sensor.markers))
    np.testing.assert_allclose(drawing.markers(nodes).numpy()[0], rest, rtol=1e-6)


@pytest.mark.parametrize("name", ["digit", "9dtact"])
def test_an_environment_without_numbers_is_black(name: str) -> None:
    """The others are drawn as before: nothing that looks like an image stands for a failure."""
    drawing, taken = _together(_model(name), name, _PUNCH, np.eye(3))
    before = drawing.images(*taken).numpy().copy()
    taken[0].numpy()[1] = np.nan
    images = drawing.images(*taken).numpy()
    np.testing.assert_array_equal(images[[0, 2]], before[[0, 2]])
    assert not images[1].any()


def test_nodes_of_another_model_are_refused() -> None:
    """Before a kernel reads beside an array."""
    drawing, (positions, *poses) = _together(_model("digit"), "digit", _PUNCH, np.eye(3))
    with pytest.raises(ConfigError, match="all environments at once"):
        drawing.images(positions[:2], *poses)
    with pytest.raises(ConfigError, match="nodes of the model"):
        drawing.markers(positions[:, 1:])


@pytest.mark.gpu
@pytest.mark.parametrize("indenter", [_PUNCH, _BODY])
def test_a_graph_on_a_gpu_gives_the_images_of_the_processor(indenter: Indenter) -> None:
    """Recorded once and replayed, they are at most a level apart."""
    rotation = tilted(*_TILT_RAD)
    host, taken = _together(_model("digit", Effect.SYMMETRY), "digit", indenter, rotation)
    model = _model("digit", Effect.SYMMETRY, device="cuda:0")
    drawing, there = _together(model, "digit", indenter, rotation)
    first = drawing.images(*there).numpy()
    drawing.markers(there[0])
    with wp.ScopedCapture(device="cuda:0") as capture:
        images, markers = drawing.images(*there), drawing.markers(there[0])
    images.zero_()
    wp.capture_launch(capture.graph)
    expected = host.images(*taken).numpy().astype(int)
    assert np.abs(images.numpy().astype(int) - expected).max() <= 1
    assert np.abs(images.numpy().astype(int) - first).max() <= 1
    np.testing.assert_allclose(markers.numpy(), host.markers(taken[0]).numpy(), atol=1e-4)


def test_unlike_bodies_of_a_batch_are_drawn_as_alone() -> None:
    """Each of a set bounds its own gel, with the gap that the solver keeps."""
    sensor, model = load_sensor("gelsight-mini"), _model("gelsight-mini")
    positions, tips = _pressed(model)
    nodes, at = wp.array(positions, dtype=wp.vec3d), wp.array(tips, dtype=wp.vec3d)
    alone = {
        body: SurfaceImages(model, body, sensor, count=3).images(nodes, at, None).numpy().copy()
        for body in (_BALL, _PUNCH)
    }
    bodies = IndenterSet(bodies=(_BALL, _PUNCH), which=(0, 1, 1))
    drawn = SurfaceImages(model, bodies, sensor, count=3).images(nodes, at, None).numpy()
    np.testing.assert_array_equal(drawn[0], alone[_BALL][0])
    np.testing.assert_array_equal(drawn[1:], alone[_PUNCH][1:])
