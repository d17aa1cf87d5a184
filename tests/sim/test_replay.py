"""Replay of measured forces, the fields it leaves, and what it says of its error."""

from pathlib import Path

import numpy as np
import pytest
import pyvista

from sim.fields.saved_press import TrialFields
from sim.mesh.elements import linear_facets
from sim.replay import reference_path, replay_forces, replay_scene
from sim.scene.indenter import Cylinder, describe
from sim.scene.material import RelaxationTerm
from sim.scene.scene import Preset, Scene
from sim.sensor.sensor import Sensor, load_sensor
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.simulated import Replay

PUNCH = Cylinder(diameter_m=5e-3, fillet_m=0.2e-3)
FORCES = (0.9, 0.4)


def _scene(friction: float, stiffer: float = 1.0) -> Scene:
    sensor = load_sensor("gelsight-mini").stiffer(stiffer)
    return replay_scene(sensor, PUNCH, FORCES, preset=Preset.FAST, friction=friction)


@pytest.fixture(scope="module")
def replayed() -> tuple[Replay, list[TrialFields], list[str]]:
    """Return a replay of two forces given in descending order."""
    lines: list[str] = []
    replay, fields = replay_forces(
        replay_scene(load_sensor("gelsight-mini"), PUNCH, FORCES, preset=Preset.FAST),
        FORCES,
        on_progress=lambda index, text: lines.append(f"{index} {text}"),
    )
    return replay, fields, lines


def test_every_force_is_met_in_its_own_place(
    replayed: tuple[Replay, list[TrialFields], list[str]],
) -> None:
    """Trials come back in the order they were given, well inside the tolerance."""
    replay, _, lines = replayed
    for trial, force in zip(replay.trials, FORCES, strict=True):
        assert trial.force_measured_n == force
        assert abs(trial.force_simulated_n - force) <= 0.008
        assert trial.balance_relative < 1e-6
        assert trial.gap_min_m > 0.0
        assert trial.force_history[-1][1] == trial.force_simulated_n
    assert [trial.index for trial in replay.trials] == [1, 2]
    assert replay.trials[0].depth_simulated_m > replay.trials[1].depth_simulated_m
    assert [line[0] for line in lines] == ["2", "1"]
    assert replay.model.young_pa == pytest.approx(0.435e6)
    assert replay.versions["warp-lang"] != "absent"


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_a_walk_tells_the_depths_of_a_replay(friction: float) -> None:
    """Steps as long as the force allows lead to the same depths."""
    scene = _scene(friction)
    reference, (replay, _) = (
        reference_path(scene, FORCES, keep_states=False),
        replay_forces(scene, FORCES),
    )
    depths, forces = zip(*reference.history, strict=True)
    for trial in replay.trials:
        told = np.interp(trial.force_measured_n, forces, depths)
        assert told == pytest.approx(trial.depth_simulated_m, rel=2e-3)
    assert len(reference.history) <= sum(len(trial.force_history) for trial in replay.trials)


@pytest.mark.parametrize(("friction", "stiffer"), [(0.0, 0.8), (0.5, 1.1)])
def test_a_stiffer_gel_goes_continue_to_where_another_passed(
    friction: float, stiffer: float
) -> None:
    """Depths, shear and the way of its force are those of a press from the start."""
    scene, other = (_scene(friction, factor) for factor in (1.0, stiffer))
    reference = reference_path(scene, FORCES, keep_states=True)
    gone_on = replay_forces(other, FORCES, reference=reference, stiffer=stiffer)
    anew = replay_forces(other, FORCES)
    for trial, known in zip(gone_on[0].trials, anew[0].trials, strict=True):
        assert trial.force_simulated_n == pytest.approx(known.force_simulated_n, rel=1e-6)
        assert trial.depth_simulated_m == pytest.approx(known.depth_simulated_m, rel=2e-4)
        assert trial.force_history[-1][1] == trial.force_simulated_n
        forces = [force for _, force in trial.force_history]
        assert forces == sorted(forces)
    for found, known_fields in zip(gone_on[1], anew[1], strict=True):
        pressure = known_fields.arrays["contact_pressure_pa"].max()
        shear = (each.arrays["contact_shear_pa"] for each in (found, known_fields))
        assert np.abs(np.subtract(*shear)).max() < 5e-3 * pressure
    assert gone_on[0].model.young_pa == other.material.young_pa
    assert gone_on[0].model.wall_s > reference.took_s


@pytest.mark.parametrize("beyond", [0.0, 1e-11, 1e-9])
def test_the_same_gel_continues_from_its_own_reference_path(beyond: float) -> None:
    """Where nothing tells the modulus, the last force is the end of the path, or that rounded."""
    reached_n = 0.9
    force_n = (1.0 + beyond) * reached_n
    scene = _scene(0.5)
    reference = reference_path(scene, [reached_n], keep_states=True)
    replay, _ = replay_forces(scene, [force_n], reference=reference)
    assert replay.trials[0].force_simulated_n == pytest.approx(force_n, rel=1e-6)
    assert replay.trials[0].depth_simulated_m == pytest.approx(reference.history[-1][0], rel=2e-4)


@pytest.mark.slow
def test_a_gel_that_relaxes_is_pressed_anew_without_a_reference_path() -> None:
    """Its stress does not scale with stiffness at the same time."""
    terms = (RelaxationTerm(share=0.2, time_s=1.0),)
    gel = load_sensor("gelsight-mini").with_gel(relaxation=terms)
    scene, other = (
        replay_scene(gel.stiffer(k), PUNCH, FORCES[1:], preset=Preset.FAST) for k in (1.0, 1.1)
    )
    reference = reference_path(scene, FORCES[1:], keep_states=True)
    assert not reference.is_usable_for(other, reference.plan)
    with pytest.raises(ConfigError, match="another way"):
        reference.path.stiffer(1.1)
    replays = [
        replay_forces(other, FORCES[1:], reference=given, stiffer=1.1)[0]
        for given in (reference, None)
    ]
    depths = [replay.trials[0].depth_simulated_m for replay in replays]
    assert depths[0] == depths[1]


def test_a_replay_says_what_it_cost_and_what_its_neighbours_would_have(
    replayed: tuple[Replay, list[TrialFields], list[str]],
) -> None:
    """The time is all trials' and the mesh's; preset fast has a better neighbour."""
    replay, _, _ = replayed
    facts = replay.model
    assert facts.wall_s >= sum(trial.wall_s["solve_s"] for trial in replay.trials)
    assert facts.force_error_largest_relative == max(
        trial.force_error_estimate or 0.0 for trial in replay.trials
    )
    better = facts.alternatives[-1]
    assert better.role == "better"
    assert better.error_relative is not None
    assert better.error_relative < facts.force_error_largest_relative


def test_fields_are_the_whole_pads(replayed: tuple[Replay, list[TrialFields], list[str]]) -> None:
    """Nodal contact forces of the whole surface sum to the trial's force."""
    replay, fields, _ = replayed
    for trial, field in zip(replay.trials, fields, strict=True):
        total = field.arrays["contact_force_n"].sum(axis=0)
        assert total == pytest.approx([0.0, 0.0, -trial.force_simulated_n], abs=1e-9)
        parts = field.arrays["contact_normal_force_n"] + field.arrays["contact_tangential_force_n"]
        assert np.allclose(parts, field.arrays["contact_force_n"])
        traction, normals = field.arrays["traction_pa"], field.arrays["face_normal"]
        split = field.arrays["tangential_traction_pa"]
        split = split + field.arrays["normal_traction_pa"][:, None] * normals
        assert np.allclose(split, traction)
        assert np.abs(np.einsum("fi,fi->f", normals, normals) - 1.0).max() < 1e-12
        pull = np.sum(traction[:, 2] * field.arrays["face_area_m2"])
        assert pull == pytest.approx(-trial.force_simulated_n, rel=0.25)


def test_surface_covers_the_pad_and_stays_below_the_indenter(
    replayed: tuple[Replay, list[TrialFields], list[str]],
) -> None:
    """What the optics get: a surface of the whole pad, upwards, pressed in the middle."""
    replay, fields, _ = replayed
    surface = fields[0].surface
    assert surface.positions_rest[:, 0].min() == pytest.approx(-25.25e-3 / 2)
    assert surface.positions_rest[:, 1].max() == pytest.approx(20.75e-3 / 2)
    assert surface.faces.shape[1] == 6
    a, b, c = (surface.positions_rest[linear_facets(surface.faces)[:, k]] for k in range(3))
    assert np.cross(b - a, c - a)[:, 2].sum() / 2 == pytest.approx(20.75e-3 * 25.25e-3, rel=1e-6)
    assert np.cross(b - a, c - a)[:, 2].min() > 0.0
    offset = surface.positions - surface.indenter_position
    roof = surface.indenter.lower_surface(offset[:, 0], offset[:, 1])
    assert describe(surface.indenter) == replay.model.indenter
    assert np.all(offset[:, 2] < np.where(np.isfinite(roof), roof + replay.model.barrier_m, 1.0))


def test_vtu_opens_in_vtk(
    replayed: tuple[Replay, list[TrialFields], list[str]], tmp_path: Path
) -> None:
    """VTK's own reader finds quadratic faces and every array, to the last digit."""
    _, fields, _ = replayed
    path = tmp_path / "surface.vtu"
    path.write_bytes(fields[0].surface_vtu)
    grid = pyvista.read(path)
    assert grid.n_cells == len(fields[0].arrays["faces"])
    assert set(grid.celltypes) == {22}
    assert np.array_equal(grid.points, fields[0].arrays["node_m"])
    assert len(grid.point_data) == 9
    assert len(grid.cell_data) == 5
    for data in (grid.point_data, grid.cell_data):
        assert all(np.array_equal(data[name], fields[0].arrays[name]) for name in data)


@pytest.mark.slow
def test_a_gel_that_relaxes_is_pressed_in_the_time_it_took() -> None:
    """A tenth of the stiffness at once, gone within 3 s: after 2 s the same force is less deep.

    Of a straight ramp 1 - exp(-x) over x is left, x = 2/3: 8 % more stiffness than for ever.
    """
    sensor = load_sensor("gelsight-mini")
    relaxing = sensor.with_gel(relaxation=(RelaxationTerm(share=0.1, time_s=3.0),))

    def depths(gel: Sensor, duration_s: float) -> list[float]:
        scene = replay_scene(gel, PUNCH, FORCES, preset=Preset.FAST, duration_s=duration_s)
        replay, _ = replay_forces(scene, FORCES)
        on = {row["name"]: row["on"] for row in replay.model.effects}["viscoelasticity"]
        assert on is (gel is relaxing)
        assert all(trial.force_error_estimate for trial in replay.trials)
        return [trial.depth_simulated_m for trial in replay.trials]

    slow, quick, waited = depths(sensor, 2.0), depths(relaxing, 2.0), depths(relaxing, 300.0)
    share = 0.1 / 0.9 * (1.0 - np.exp(-2.0 / 3.0)) / (2.0 / 3.0)
    assert np.divide(slow, quick) == pytest.approx(1.0 + share, abs=0.02)
    assert waited == pytest.approx(slow, rel=2e-3)
