"""What is kept of a press on its way, and how far its markers are off."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sim.optics.markers.printed_markers import draw_markers, find_markers, marker_places
from sim.replay import reference_path, replay_forces
from sim.scene.scene import Preset
from sim.sensor.sensor import MarkerGrid
from tacauchy_rig.app.replay.inputs import ReplayInputs, inputs_of
from tacauchy_rig.app.replay.optics import nominal_optics
from tacauchy_rig.app.replay.rendering import (
    STATES,
    WIDTH_PX,
    intermediate_arrays,
    marker_motion,
    spread,
)
from tacauchy_rig.core.config.load import load_config
from tests.sim.optics.analytic_surface import APEX_M, camera, pressed_surface

FORCES_N = (1.0, 3.0)


@pytest.fixture(scope="module")
def inputs() -> ReplayInputs:
    """A press of the dry run's punch, coarse."""
    config = load_config(overrides=['replay.preset="fast"']).config
    return inputs_of(config)


@pytest.fixture(scope="module")
def arrays(inputs: ReplayInputs) -> dict[int, dict[str, Any]]:
    """What is kept of two presses."""
    scene = inputs.scene(FORCES_N)
    assert scene.preset is Preset.FAST
    _, fields = replay_forces(scene, FORCES_N)
    optics = nominal_optics(inputs.sensor)
    grey = np.full((optics.geometry.height, optics.geometry.width, 3), 110, dtype=np.uint8)
    attempts: list[Any] = [
        SimpleNamespace(record=SimpleNamespace(index=k), reference=grey) for k in (1, 2)
    ]
    return intermediate_arrays(attempts, inputs.sensor, dict(enumerate(fields, start=1)), optics)


def test_states_rise_to_the_force(arrays: dict[int, dict[str, Any]]) -> None:
    """Few, ascending, the press's own last, what lies below a smaller one among a larger one's."""
    for trial, force_n in enumerate(FORCES_N, start=1):
        found = arrays[trial]
        assert 3 <= len(found["force_n"]) <= STATES
        assert np.all(np.diff(found["force_n"]) > 0.0)
        assert np.all(np.diff(found["depth_m"]) > 0.0)
        assert found["force_n"][-1] == pytest.approx(force_n, rel=1e-3)
        assert found["force_n"][0] < 0.3 * force_n
        shape = found["image"].shape[:3]
        assert shape == found["dent_m"].shape == found["pressure_pa"].shape
        assert shape[2] <= WIDTH_PX


def test_pressure_sums_up_to_the_force(
    arrays: dict[int, dict[str, Any]], inputs: ReplayInputs
) -> None:
    """Over the pixels of a map, at every state; the dent is as deep as the press."""
    geometry = nominal_optics(inputs.sensor).geometry
    seen_m2 = geometry.width * geometry.scale_x_m * geometry.height * geometry.scale_y_m
    for found in arrays.values():
        summed = found["pressure_pa"].mean(axis=(1, 2)) * seen_m2
        # Linear between the nodes of a coarse mesh, whose rim carries the peak.
        np.testing.assert_allclose(summed, found["force_n"], rtol=0.1)
        np.testing.assert_allclose(found["dent_m"].max(axis=(1, 2)), found["depth_m"], rtol=0.06)
        change = np.abs(found["image"].astype(float) - 110.0).mean(axis=(1, 2, 3))
        assert np.all(np.diff(change) > 0.0)


def test_a_walk_with_another_gel_passes_the_same(inputs: ReplayInputs) -> None:
    """Force and pressure scale with stiffness, depths do not."""
    reference = reference_path(inputs.scene(FORCES_N), FORCES_N, keep_states=True)
    other = replace(inputs, sensor=inputs.sensor.stiffer(1.2))
    _, (_, gone_on) = replay_forces(
        other.scene(FORCES_N), FORCES_N, reference=reference, stiffer=1.2
    )
    _, (_, anew) = replay_forces(other.scene(FORCES_N), FORCES_N)
    for fields in (gone_on, anew):
        forces = [state.force_n for state in fields.intermediate]
        assert forces == sorted(forces)
    ways = [
        (
            [state.force_n for state in fields.intermediate],
            [state.depth_m for state in fields.intermediate],
            [state.pressure_pa.max() for state in fields.intermediate],
        )
        for fields in (gone_on, anew)
    ]
    for told, known in zip(ways[0][1:], ways[1][1:], strict=True):
        np.testing.assert_allclose(np.interp(ways[1][0], ways[0][0], told), known, rtol=0.03)


def test_a_few_of_many_end_with_the_last() -> None:
    """Evenly, and all where there are few."""
    many: list[Any] = list(range(20))
    assert len(spread(many)) == STATES
    assert spread(many)[-1] == 19
    assert len(set(spread(many))) == STATES
    assert spread(many[:3]) == many[:3]


GRID = MarkerGrid(columns=4, rows=3, pitch_m=(2.4e-3, 2.2e-3), radius_m=3.5e-4)


def test_a_trial_states_how_far_its_markers_are_off() -> None:
    """A surface that moves by 0.2 mm where the recording moved by 0.3 mm is 0.1 mm, 1 px off."""
    view, places = camera(), marker_places(GRID)
    plain = np.full((96, 128, 3), 140, np.uint8)
    rest = draw_markers(plain, places, GRID.radius_m, view)
    loaded = draw_markers(plain, places + np.array([3e-4, 0.0]), GRID.radius_m, view)
    markers = find_markers(rest)
    assert markers is not None
    flat = pressed_surface(lambda x, _: np.full_like(x, APEX_M))
    surface = replace(flat, positions=flat.positions + np.array([2e-4, 0.0, 0.0]))
    found = marker_motion(3, markers, loaded, surface, view)
    assert (found.trial, found.drawn, found.tracked, found.lost) == (3, 12, 12, 0)
    assert found.apart_median_px == pytest.approx(1.0, abs=0.1)
    assert found.apart_rms_m == pytest.approx(1e-4, rel=0.1)
    assert found.simulated_largest_m == pytest.approx(2e-4, rel=0.01)
    assert found.tracking_error_px is not None
    assert found.tracking_error_px < 0.1
    assert marker_motion(3, markers, None, surface, view).tracked is None
