"""What libuipc is given of a scene, and how its answers are judged.

libuipc itself is not needed: what it would give is made by our own solver on its mesh.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from sim.batch.environment import Trajectory
from sim.scene.indenter import Cylinder, Plane, Sphere
from sim.scene.material import LawName
from sim.scene.scene import ContactMode, Motion, Preset, Scene, Target
from sim.solve.loading_path import LoadingPath
from sim.studies.bench.press import stated_scene, within
from sim.studies.bench.scenes import FRAME_COUNT, all_scenes
from tacauchy_rig.core.errors import ConfigError
from tests.studies.libuipc.pad import PeerPad, peer_pad, peer_press, strayed, triangles
from tests.studies.libuipc.task import AS_SHIPPED, STRICT, PeerFound, PeerTask

_DEPTH_M = 0.2e-3


def _stated(name: str) -> Scene:
    (line,) = (scene for scene in all_scenes() if scene.name == name)
    return stated_scene(line.stated)


def _scene(name: str) -> Scene:
    return within(_stated(name), "5%")[0]


@pytest.fixture(scope="module")
def pad() -> PeerPad:
    """Return the pad of two layers as libuipc gets it, coarse, pressed 0.2 mm deep."""
    scene = _scene("9DTact, two layers")
    target = Target(depth_m=_DEPTH_M)
    return peer_pad(replace(scene, target=target, refinement=0.5 * scene.refinement))


@pytest.fixture(scope="module")
def task(pad: PeerPad) -> PeerTask:
    """Return two environments unlike each other."""
    return pad.task(count=2, tolerance=AS_SHIPPED)


@pytest.fixture(scope="module")
def found(pad: PeerPad) -> PeerFound:
    """Return an equilibrium of the first environment on libuipc's mesh, by our solver."""
    model = pad.model
    point = LoadingPath(model, pad.scene.indenter).advance(_DEPTH_M)
    forces = model.surface.forces(point.state.positions, pad.scene.indenter, point.state).forces
    return PeerFound(
        set_up_s=1.0,
        press_s=((0.2, 0.3), (0.1, 0.4)),
        newton_iterations=(3, 5),
        positions=point.state.positions[None],
        tips_m=point.state.tip[None],
        contact_n=-model.surface.scatter(forces)[None],
    )


def test_an_equilibrium_balances(pad: PeerPad, task: PeerTask, found: PeerFound) -> None:
    """Base against contact, by our law of both layers; a force a tenth too large is seen."""
    alone = pad.task(count=1, tolerance=AS_SHIPPED)
    press = peer_press(pad, alone, found)
    contact_n = found.contact_n
    assert contact_n is not None
    assert press.force_n[2] == pytest.approx(-contact_n[0, :, 2].sum(), rel=1e-4)
    assert press.balance < 1e-4
    assert press.depth_m == pytest.approx(_DEPTH_M)
    assert (press.wall_s, press.iterations, press.preset) == (0.1, 8, "as shipped")
    short = found.tips_m + np.array([0.0, 0.0, 3e-6])
    assert strayed(alone, found) == ()
    assert "3.0 um" in strayed(alone, replace(found, tips_m=short))[0]
    wrong = peer_press(pad, alone, replace(found, contact_n=1.1 * contact_n))
    assert wrong.balance == pytest.approx(0.1 / 1.1, rel=1e-3)
    assert math.isnan(peer_press(pad, alone, replace(found, contact_n=None)).balance)
    both = replace(
        found,
        positions=np.repeat(found.positions, 2, axis=0),
        tips_m=np.repeat(found.tips_m, 2, axis=0),
        contact_n=np.repeat(contact_n, 2, axis=0),
    )
    # The other environment is stiffer: the same positions are no equilibrium of it.
    assert peer_press(pad, task, both).balance > 0.01


def test_libuipc_gets_the_whole_pad_with_its_layers(pad: PeerPad, task: PeerTask) -> None:
    """Linear tetrahedra fill it; the skin is stiffer by the tetrahedra; pads lie apart."""
    assert pad.model.volume_m3 == pytest.approx(28e-3 * 21e-3 * 4e-3, rel=1e-9)
    assert task.tets.shape[1] == 4
    shear = np.unique(task.shear_pa[0])
    assert shear[1] / shear[0] == pytest.approx(4.0)
    assert np.all(task.shear_pa[1] > task.shear_pa[0])
    apart = np.abs(np.subtract(*task.origins_m)).max()
    assert apart > 2.0 * np.ptp(task.nodes[:, 0])
    assert task.poses.shape == (FRAME_COUNT, 2, 4, 4)
    assert task.start[0, 2, 3] - task.poses[-1, 0, 2, 3] == pytest.approx(_DEPTH_M)
    assert task.poses[-1, 1, 2, 3] > task.poses[-1, 0, 2, 3]


def test_poses_go_the_scenes_way(pad: PeerPad) -> None:
    """Beside the middle, along, turned about z after the tilt."""
    scene = replace(
        pad.scene, centre_m=(1e-3, 2e-3), motion=Motion(tilt_rad=(0.1, 0.0), twist_rad=0.2)
    )
    trajectory = Trajectory(
        depths_m=np.array([0.1e-3]), shifts_m=np.array([[3e-4, 0.0]]), turns_rad=np.array([0.2])
    )
    task = replace(pad, scene=scene, trajectory=trajectory).task(count=1, tolerance=STRICT)
    pose = task.poses[0, 0]
    assert pose[:3, 3] == pytest.approx([1.3e-3, 2e-3, pad.touch_m - 0.1e-3])
    axis = pose[:3, :3] @ [0.0, 0.0, 1.0]
    assert axis == pytest.approx(
        [np.sin(0.2) * np.sin(0.1), -np.cos(0.2) * np.sin(0.1), np.cos(0.1)]
    )
    assert task.start[0, :3, :3] == pytest.approx(
        np.array([[1, 0, 0], [0, np.cos(0.1), -np.sin(0.1)], [0, np.sin(0.1), np.cos(0.1)]])
    )


def test_a_load_becomes_the_depths_that_our_press_found() -> None:
    """Down until 1 N, then along; friction is the scene's."""
    pad = peer_pad(replace(_stated("ball, sliding"), preset=Preset.FAST))
    depths = pad.trajectory.along
    assert not pad.trajectory.is_pushed
    assert np.all(np.diff(depths[:10]) > 0.0)
    assert pad.trajectory.goals[-1, 1:3] == pytest.approx([0.3e-3, 0.0])
    task = pad.task(count=1, tolerance=STRICT)
    assert task.friction == pytest.approx(0.5)
    assert task.resistance > 0.0


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"indenter": Plane()}, "unbounded plates"),
        ({"contact": ContactMode.BONDED}, "bonded contact"),
        ({"law": LawName.NEO_HOOKEAN}, "other laws"),
    ],
)
def test_what_libuipc_cannot_do_is_said(change: dict[str, object], named: str) -> None:
    """In a few words."""
    scene = _scene("punch, rounded")
    law = change.pop("law", scene.material.law)
    scene = replace(scene, material=replace(scene.material, law=str(law)), **change)  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match=f"libuipc has no {named}"):
        peer_pad(scene)


@pytest.mark.parametrize(
    "body", [Sphere(diameter_m=10e-3), Cylinder(diameter_m=5e-3, fillet_m=0.3e-3)]
)
def test_round_bodies_become_closed_triangles(body: Sphere | Cylinder) -> None:
    """On the body where it touches, to 4 um, and their tip at the origin."""
    found = triangles(body)
    middles = found.vertices[found.faces].mean(axis=1)
    touching = middles[(found.face_normals[:, 2] < -0.7) & (middles[:, 2] < 0.5e-3)]
    exact = body.lower_surface(touching[:, 0], touching[:, 1])
    assert np.abs(touching[:, 2] - exact).max() < 4e-6
    assert found.vertices[:, 2].min() == 0.0
    corners = found.vertices[found.faces]
    volumes = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    assert volumes.sum() > 0.0
