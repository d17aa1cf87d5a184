"""The plant: pose in, wrench and surface out."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.emulators.force_sensor.m8128_box_and_noise import ForceChannel
from drivers.emulators.plant.gel_response import Plant, Relaxation, tilted_depths
from drivers.emulators.plant.truth import CylinderTip, PlantTruth, draw_truth
from tacauchy_rig.core.run import Pose

SURFACE = (0.0, -0.4, 0.2)
DOWN = (0.0, math.pi, 0.0)
TRUTH = draw_truth(7)


def _plant(truth: PlantTruth = TRUTH) -> Plant:
    return Plant(truth, CylinderTip(diameter_m=5e-3), SURFACE)


def _pose(depth: float, *, x: float = 0.0, y: float = 0.0) -> Pose:
    """Return a pose about ``depth`` below the real surface of the world of TRUTH."""
    return Pose(
        position=(x, SURFACE[1] + y, SURFACE[2] + TRUTH.surface_error_m - depth),
        rotation_vector=DOWN,
    )


@given(st.floats(1e-5, 0.1))
def test_zero_force_out_of_contact(height: float) -> None:
    """Higher than a face reaches that tilts by 0.15 deg, there is exactly nothing."""
    plant = _plant()
    for free in (_pose(-height), _pose(1e-3, x=15e-3)):  # or beside the pad
        assert plant.wrench(free, 0) == ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert plant.surface_at(plant.depth(_pose(-height)), (0.0, 0.0)).contact_radius == 0.0


def test_the_force_pushes_the_indenter_up() -> None:
    """A press gives a few newtons along +z, little sideways, and a moment from the pose error."""
    force, torque = _plant().wrench(_pose(0.5e-3), 0)
    assert 2.5 < force[2] < 4.5
    assert math.hypot(*force[:2]) < 0.01 * force[2]
    arm_x, arm_y = TRUTH.pose_error_m
    assert torque[0] == pytest.approx(arm_y * force[2], abs=1e-4)
    assert torque[1] == pytest.approx(-arm_x * force[2], abs=1e-4)
    assert _plant().centre(_pose(1e-4)) == pytest.approx(TRUTH.pose_error_m), "where it really is"


def test_force_decays_during_a_dwell() -> None:
    """Pressed at 0.3 mm/s and held, the force falls by a few per cent and never rises."""
    plant = _plant()
    for i in range(200):
        plant.wrench(_pose(0.3e-3 * i * 0.01), i * 10_000_000)
    held = [plant.wrench(_pose(0.6e-3), (200 + i) * 10_000_000)[0][2] for i in range(1000)]
    assert np.all(np.diff(held) <= 0.0)
    assert 0.01 < 1.0 - held[-1] / held[0] < 0.06


def test_beyond_the_table_the_gel_stiffens_without_a_jump() -> None:
    """Force goes on smoothly past the deepest row and bends upwards, so a guard must bite."""
    plant = _plant()
    last = float(plant.table.depths[-1])
    below, at, above = (plant.relaxed(last + shift)[0] for shift in (-1e-7, 0.0, 1e-7))
    assert at - below == pytest.approx(above - at, rel=1e-2)
    step = 2e-4
    first = plant.relaxed(last + step)[0] - plant.relaxed(last)[0]
    second = plant.relaxed(last + 2 * step)[0] - plant.relaxed(last + step)[0]
    assert second > 1.3 * first


def test_force_does_not_depend_on_how_often_it_is_asked() -> None:
    """100 Hz and 500 Hz see the same force at the same moment."""
    slow, fast = _plant(), _plant()
    for i in range(101):
        coarse = slow.wrench(_pose(5e-6 * i), i * 10_000_000)
    for i in range(501):
        fine = fast.wrench(_pose(1e-6 * i), i * 2_000_000)
    assert coarse[0][2] == pytest.approx(fine[0][2], rel=1e-4)


def test_the_surface_follows_the_flat_face() -> None:
    """Inside the contact the gel is the tip's face; far away it keeps its own shape."""
    profile = _plant().surface_at(0.5e-3, (0.0, 0.0))
    inside = profile.radius < 0.9 * profile.contact_radius
    np.testing.assert_allclose(profile.height[inside], -0.5e-3, atol=1e-6)
    assert np.all(np.diff(profile.radius) >= 0.0)
    assert 2.4e-3 < profile.contact_radius <= 2.51e-3


def _tilted(degrees: float, **changes: object) -> Plant:
    return _plant(replace(TRUTH, tilt_rad=(math.radians(degrees), 0.0), **changes))


def test_a_tilted_face_is_the_gel_under_it() -> None:
    """Inside the contact the surface tilts as the face does, deeper on the side it tilts to."""
    profile = _tilted(1.0).surface_at(0.5e-3, (0.0, 0.0), (math.radians(1.0), 0.0))
    inside = (profile.radius > 0.0) & (profile.radius < 0.9 * profile.contact_radius)
    np.testing.assert_allclose(profile.tilt_height[inside], -profile.radius[inside], rtol=0.01)
    far = profile.radius > 3.0 * profile.contact_radius
    assert np.abs(profile.tilt_height[far]).max() < 0.05 * profile.contact_radius


def test_a_tilted_face_presses_on_its_lower_side() -> None:
    """The moment turns the tool upright, twice as much for twice the tilt."""
    still = {"pose_error_m": (0.0, 0.0)}
    moments = [
        _tilted(degrees, **still).wrench(_pose(0.5e-3), 0)[1][1] for degrees in (0.0, 0.5, 1.0)
    ]
    assert abs(moments[0]) < 1e-12
    assert moments[2] == pytest.approx(2.0 * moments[1], rel=1e-3)
    # Of a half-space under a rigid disc, which a layer of 1.6 radii is well below of.
    stiffness = _plant().relaxed(0.5e-3)[1]
    half_space = 2.0 / 3.0 * 2.5e-3**2 * stiffness * math.radians(1.0)
    assert 0.4 * half_space < -moments[2] < 0.7 * half_space


def test_a_tilted_face_touches_a_dome_off_its_middle_and_earlier() -> None:
    """A dome of radius R is touched R l^2 / 2 earlier; pressed in all around, nothing changes."""
    tilt = math.radians(1.0)
    depth, even = tilted_depths(2.5e-3, 134e-3, tilt)
    early = 0.5 * 134e-3 * tilt**2
    assert np.interp(-0.9 * early, depth, even) == pytest.approx(0.1 * early, abs=2e-6)
    assert np.interp(3e-4, depth, even) == pytest.approx(3e-4, rel=1e-3)


def test_the_sensor_reads_compression_as_positive() -> None:
    """Offset, drift, cross talk and noise come on top of the wrench; Fz rises when pressed."""
    quiet = replace(TRUTH, force_noise_n=0.0, torque_noise_nm=0.0)
    channel = ForceChannel(quiet, start_ns=0)
    idle = channel.reading((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), DOWN, 0)
    assert idle[:3] == pytest.approx(TRUTH.force_offset_n)
    pressed = channel.reading((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), DOWN, 100_000_000_000)
    assert pressed[2] - idle[2] == pytest.approx(3.0 + 100.0 * TRUTH.force_drift_n_s)
    assert pressed[0] - idle[0] == pytest.approx(3.0 * TRUTH.cross_talk[0])
    zero, noisy = (0.0, 0.0, 0.0), ForceChannel(TRUTH, start_ns=0)
    scatter = np.std([noisy.reading(zero, zero, DOWN, 0)[2] for _ in range(1000)])
    assert scatter == pytest.approx(TRUTH.force_noise_n, rel=0.1)


WEIGHTS, TIMES = (0.03, 0.04), (0.3, 3.0)


@given(st.lists(st.tuples(st.floats(0.5, 5.0), st.floats(0.001, 2.0)), min_size=1, max_size=12))
def test_recursion_is_the_convolution(steps: list[tuple[float, float]]) -> None:
    """For forces that are linear between samples both agree to rounding."""
    force = np.array([0.0] + [value for value, _ in steps])
    time = np.concatenate([[0.0], np.cumsum([duration for _, duration in steps])])
    relaxation = Relaxation(WEIGHTS, TIMES)
    found = [relaxation.advance(value, duration) for value, duration in steps][-1]
    expected = force[-1]
    for weight, tau in zip(WEIGHTS, TIMES, strict=True):
        decay = np.exp((time - time[-1]) / tau)
        # integral of exp((s - t) / tau) dF/ds over each straight piece
        expected += weight * np.sum(np.diff(force) / np.diff(time) * tau * np.diff(decay))
    assert found == pytest.approx(max(0.0, expected), rel=1e-9, abs=1e-9)
    # Gel that has not yet risen does not pull.
    assert [relaxation.advance(0.0, 0.01) for _ in range(2)] == [0.0, 0.0]
