"""What is kept of a press on its way, and what moments and images of a run tell of its tool."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from reports.evidence.evidence_types import TrialImages
from sim.optics.markers.marker_tracking import find_markers
from sim.optics.markers.simulated_markers import draw_markers, marker_places
from sim.replay import reference_path, replay_forces
from sim.scene.scene import Preset
from sim.sensor.sensor import MarkerGrid, load_sensor
from tacauchy_rig.app.replay.chosen_optics import nominal_optics
from tacauchy_rig.app.replay.rendering import STATES, WIDTH_PX, intermediate_arrays, marker_motion
from tacauchy_rig.app.replay.simulator_inputs import Part, ReplayInputs, inputs_of
from tacauchy_rig.app.replay.tilt_and_place import (
    Dwell,
    find_offset,
    mounted,
    offset_of,
    tilt_of,
    tilted_curve,
)
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.simulated import ForceDepthCurve
from tests.sim.optics.analytic_surface import APEX_M, camera, pressed_surface
from tests.studies.mounting.command import drawn_dwells

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


DEGREE = math.radians(1.0)
FAST = "replay.preset=fast"


def configured(*overrides: str) -> RigConfig:
    """Return the defaults with ``table.field=value`` overrides."""
    return load_config(overrides=overrides).config


def found_in(dwells: list[Dwell], config: RigConfig) -> Part:
    """Return the presses with the tilt that dwells show."""
    part = Part(inputs=inputs_of(config), records=(), config=config)
    known: dict[str, Any] = {"press_duration_s": None}
    seen: list[Any] = [SimpleNamespace(record=r, dwell_wrench=w, **known) for r, w in dwells]
    return mounted(part, seen)


@pytest.mark.slow
def test_a_tilt_that_costs_too_much_is_simulated() -> None:
    """A degree, in an emulated world of another gel, arm and noise, is found and switched on."""
    config = configured()
    dwells = drawn_dwells(21, (0.8 * DEGREE, -0.6 * DEGREE), config)
    found = found_in(dwells, config)
    tilt = np.array(found.inputs.tilt_rad)
    doubt = np.array([value.uncertainty for value in found.found])
    assert np.all(np.abs(tilt - np.array([0.8, -0.6]) * DEGREE) < 2.5 * doubt)
    assert np.all(doubt < 0.25 * DEGREE)
    (row,) = found.effects
    assert row["on"]
    assert "image would be" in row["reason"]
    assert found.inputs.scene([2.0]).motion.tilt_rad == (-tilt[1], tilt[0])


@pytest.mark.parametrize(
    ("seed", "tilt_rad", "overrides", "taken", "why"),
    [
        (3, 0.02 * DEGREE, (), False, "within 2 times its uncertainty of none"),
        pytest.param(21, DEGREE, (FAST,), True, "10.00% allowed", marks=pytest.mark.slow),
    ],
)
def test_a_tilt_of_no_consequence_is_left_out(
    seed: int, tilt_rad: float, overrides: tuple[str, ...], taken: bool, why: str
) -> None:
    """An upright tool stays upright; preset fast allows an image to be off by more than a degree's.

    The row says why.
    """
    config = configured(*overrides)
    dwells = drawn_dwells(seed, (tilt_rad, 0.0), config)[1::2]
    found = found_in(dwells, config)
    assert found.inputs == inputs_of(config)
    assert all(value.taken for value in found.found) == taken
    assert why in found.effects[0]["reason"]
    assert not found.effects[0]["on"]


@pytest.mark.parametrize(
    ("overrides", "kept", "why"),
    [
        (('indenter.kind="sphere"',), slice(None), "does not change a ball"),
        ((), slice(2), "2 presses carry moments"),
        ((), slice(0), "0 presses carry moments"),
        pytest.param(
            ('workspace.max_tilt="0.5 deg"',),
            slice(3),
            "more than workspace.max_tilt",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_what_tells_no_tilt_says_why(overrides: tuple[str, ...], kept: slice, why: str) -> None:
    """Nothing is taken, and what was stated stays."""
    dwells = drawn_dwells(3, (DEGREE, 0.0), configured())[kept]
    config = configured(*overrides, 'replay.tilt=["0.5 deg", "0 deg"]')
    found = found_in(dwells, config)
    assert all(value.value is None and why in value.basis for value in found.found)
    assert found.inputs.tilt_rad == (0.5 * DEGREE, 0.0)


def test_moments_are_taken_about_the_tip() -> None:
    """A side force at the tip is no tilt, however far the cell's point is from it."""
    config = configured('force_sensor.to_tip="80 mm"')
    dwells = drawn_dwells(21, (0.8 * DEGREE, -0.6 * DEGREE), configured())[1::2]
    near, _ = tilt_of(dwells, inputs_of(config), configured())
    moved_dwells = [(record, _about(wrench, 0.08)) for record, wrench in dwells]
    far, _ = tilt_of(moved_dwells, inputs_of(config), config)
    assert near is not None
    assert far is not None
    assert far.tilt_rad == pytest.approx(near.tilt_rad, abs=0.05 * DEGREE)
    # Cross talk of half a per cent would be 0.4 mm on that lever.
    assert far.arm_m == pytest.approx(near.arm_m, abs=2e-5)


def _about(
    wrench: tuple[np.ndarray, np.ndarray] | None, above_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return a wrench of the emulated cell, its z up, about a point above the tip."""
    assert wrench is not None
    mean, error = wrench[0].copy(), wrench[1]
    mean[3:] += np.cross([0.0, 0.0, -above_m], mean[:3])
    return mean, error


def test_a_stated_pose_is_taken_as_it_is() -> None:
    """Nothing is looked for."""
    config = configured("replay.pose=stated", 'replay.tilt=["0.5 deg", "0 deg"]')
    found = found_in([], config)
    assert found.inputs == inputs_of(config)
    assert found.found == found.effects == ()


def test_a_tilt_begins_deeper() -> None:
    """Depth counts from the first touch, which a tilted face has off the middle of the dome."""
    config = configured('replay.tilt=["1 deg", "0 deg"]')
    curve = ForceDepthCurve(depth_m=np.array([0.0, 2e-4, 4e-4]), force_n=np.array([0.0, 1.2, 2.5]))
    shifted = tilted_curve(curve, inputs_of(config))
    assert shifted is not None
    extra = shifted.depth_m[1:] - curve.depth_m[1:]
    # The dome's radius along x is 185 mm: touched R l^2 / 2 = 28 um earlier.
    assert np.all((extra > 1.5e-5) & (extra < 3.5e-5))
    assert shifted.depth_m[0] == 0.0


def _attempts(shift_px: float) -> list[SimpleNamespace]:
    """Return trials with a dark disc, seen beside where it is simulated."""
    rows, columns = np.mgrid[:240, :320]

    def disc(beside: float) -> np.ndarray:
        far = np.hypot(columns - 160.0 - beside, rows - 120.0) - 40.0
        dark = 60.0 / (1.0 + np.exp(far / 3.0))
        return np.repeat(np.rint(160.0 - dark)[..., None], 3, axis=2).astype(np.uint8)

    seen = TrialImages(real=disc(shift_px), reference=np.full((240, 320, 3), 160, np.uint8))
    return [
        SimpleNamespace(record=SimpleNamespace(index=k), images=seen, made=disc(0.0))
        for k in (1, 2, 3)
    ]


@pytest.mark.parametrize(("shift_px", "taken"), [(3.0, True), (0.3, False)])
def test_a_place_beyond_what_the_arm_repeats_to_is_found(shift_px: float, taken: bool) -> None:
    """Three pixels are 0.19 mm; a third of one, rounded to 8 bits, is within the arm's 0.03 mm.

    One image tells nothing: a scatter takes two.
    """
    config, camera = configured(), load_sensor("gelsight-mini").camera
    attempts = _attempts(shift_px)
    images = {each.record.index: each.made for each in attempts}
    values = find_offset(attempts, images, camera, config)  # type: ignore[arg-type]
    assert values[0].value == pytest.approx(shift_px * camera.scale_x_m, abs=4e-6)
    assert values[1].value == pytest.approx(0.0, abs=2e-6)
    beside = offset_of(values)
    assert (beside is not None) is taken
    if beside is not None:
        x, y = inputs_of(config).moved(beside).offset_m
        assert (x, y) == pytest.approx(beside)
    alone = find_offset(attempts[:1], images, camera, config)  # type: ignore[arg-type]
    assert offset_of(alone) is None
    assert "at least two are needed" in alone[0].basis
