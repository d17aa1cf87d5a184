"""libuipc beside ours: its mesh, its task, how its answers are judged, and its absence.

libuipc itself is not needed: what it would give is made by our own solver on the peer's mesh.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from sim.arrays import FloatArray
from sim.batch.pilot import batch_model
from sim.mesh.elements import boundary_faces
from sim.mesh.tet_mesh import TetMesh
from sim.scene.indenter import Cylinder, Sphere
from sim.scene.material import Material
from sim.scene.pad import DiscPad
from sim.scene.scene import Preset, Scene, Target
from sim.solve.load_steps.path import LoadingPath
from sim.studies.bench.batches import BALANCE, BatchRow, StressTimes
from sim.studies.bench.frames import FRAME_COUNT
from sim.studies.bench.peer.comparison import PeerRow, peer_table, why_no_libuipc
from sim.studies.bench.peer.libuipc import press_in_libuipc
from sim.studies.bench.peer.pad import (
    PeerBalance,
    PeerMesh,
    PeerPad,
    linear_mesh,
    peer_balance,
    peer_pad,
)
from sim.studies.bench.peer.task import AS_SHIPPED, FRAME_S, LADDER, PeerFound, PeerTask
from sim.studies.processes import OwnProcess, ProcessFailedError

_BODY = Cylinder(diameter_m=5e-3, fillet_m=1.5e-3)
_SCENE = Scene(
    pad=DiscPad(radius_m=9e-3, height_m=4e-3),
    material=Material(young_pa=0.4e6, poisson=0.45),
    indenter=_BODY,
    target=Target(depth_m=1e-3),
    preset=Preset.FAST,
)
_DEPTH_M = 0.2e-3
_DISTANCE_M = 4e-5


@pytest.fixture(scope="module")
def pad() -> PeerPad:
    """Return the pad as the peer gets it: our tetrahedra, linear."""
    whole = batch_model(_SCENE, symmetric=False)
    return peer_pad(_SCENE, whole, PeerMesh.CORNERS)


@pytest.fixture(scope="module")
def task(pad: PeerPad) -> PeerTask:
    """Return two environments that are pressed 0.2 mm deep."""
    asked = pad.task(count=2, tolerance=AS_SHIPPED, load_n=1.0)
    return replace(asked, young_pa=np.array([4e5, 5e5]), depths_m=np.full((1, 2), _DEPTH_M))


@pytest.fixture(scope="module")
def found(pad: PeerPad) -> PeerFound:
    """Return an equilibrium on the peer's mesh in both environments, found by our solver."""
    model = pad.model
    point = LoadingPath(model, _BODY).advance(_DEPTH_M)
    forces = model.surface.forces(point.state.positions, _BODY, point.state).forces
    contact = -model.surface.scatter(forces)
    return PeerFound(
        version="0",
        set_up_s=1.0,
        press_s=(0.2, 0.1),
        newton_iterations=(3, 5),
        linear_iterations=(30, 50),
        positions=np.stack([point.state.positions] * 2),
        tips_m=np.full(2, point.state.tip[2]),
        contact_n=np.stack([contact, 1.25 * contact]),
    )


@pytest.mark.parametrize("kind", PeerMesh)
def test_linear_tetrahedra_fill_the_same_pad(pad: PeerPad, kind: PeerMesh) -> None:
    """Same volume, same closed surface, every tetrahedron positive, eight of one where cut."""
    whole = pad.whole.mesh
    mesh = linear_mesh(whole, kind)
    assert len(mesh.tets) == len(whole.tets) * (8 if kind is PeerMesh.NODES else 1)
    assert _volumes(mesh).min() > 0.0
    assert _volumes(mesh).sum() == pytest.approx(_volumes(whole).sum(), rel=1e-12)
    faces, _ = boundary_faces(mesh.tets)
    of_whole, _ = boundary_faces(whole.tets)
    assert len(faces) == len(of_whole) * (4 if kind is PeerMesh.NODES else 1)
    if kind is PeerMesh.NODES:
        assert len(mesh.vertices) == len(pad.whole.nodes)


def test_the_peer_gets_the_whole_pad(pad: PeerPad) -> None:
    """The pad without symmetry is four of the batch's quarter, in volume and in tetrahedra."""
    quarter = batch_model(_SCENE)
    assert len(pad.model.elements) == 4 * len(quarter.mesh.tets)
    assert pad.whole.volume_m3 == pytest.approx(4.0 * quarter.volume_m3, rel=1e-12)


def test_a_task_is_the_batch_of_the_same_environments(pad: PeerPad) -> None:
    """Gels, depths, d_hat and touch height are the batch's; pads do not overlap."""
    asked = pad.task(count=8, tolerance=AS_SHIPPED, load_n=5.0)
    assert asked.count == 8
    assert asked.depths_m.shape == (FRAME_COUNT, 8)
    assert asked.depths_m[-1, 0] == pytest.approx(1e-3)
    assert asked.young_pa[0] == _SCENE.material.young_pa
    assert asked.distance_m == pad.whole.contact_options.distance_m
    top = pad.whole.nodes[:, 2].max()
    assert asked.touch_m == pytest.approx(top + asked.distance_m, rel=1e-6)
    apart = asked.origins_m[:, None] - asked.origins_m
    distances = np.abs(apart).max(axis=2)[~np.eye(8, dtype=bool)]
    assert distances.min() > 2.0 * np.ptp(asked.nodes[:, 0])


def test_an_equilibrium_balances(pad: PeerPad, task: PeerTask, found: PeerFound) -> None:
    """Base against contact, and all nodes, to the solver's tolerance, at either modulus."""
    balance = peer_balance(pad, task, found)
    contact = found.contact_n
    assert contact is not None
    assert balance.force_n == pytest.approx(-contact[0, :, 2].sum(), rel=1e-4)
    assert balance.imbalance < 1e-4
    assert balance.residual < 1e-4
    assert 0.0 < balance.gap_m < 1.1 * _DISTANCE_M
    assert abs(balance.depth_error_m) < 1e-6


def test_what_does_not_balance_is_seen(pad: PeerPad, task: PeerTask, found: PeerFound) -> None:
    """A contact force a tenth too large in one environment is ten percent of imbalance."""
    contact = found.contact_n
    assert contact is not None
    wrong = replace(found, contact_n=contact * np.array([1.0, 1.1])[:, None, None])
    balance = peer_balance(pad, task, wrong)
    assert balance.imbalance == pytest.approx(0.1 / 1.1, rel=1e-3)
    assert balance.residual > 0.01
    silent = peer_balance(pad, task, replace(found, contact_n=None))
    assert math.isnan(silent.imbalance)
    assert math.isnan(silent.residual)
    assert silent.force_n == pytest.approx(balance.force_n)


def test_a_wrong_depth_is_seen(pad: PeerPad, task: PeerTask, found: PeerFound) -> None:
    """An indenter that a soft drive leaves 3 um short is 3 um short in the table."""
    short = replace(found, tips_m=found.tips_m + np.array([0.0, 3e-6]))
    balance = peer_balance(pad, task, short)
    assert balance.depth_error_m == pytest.approx(-3e-6, rel=0.2)


def test_tolerances_grow_stricter() -> None:
    """As shipped changes nothing; every rung of the ladder is stricter than the one before."""
    assert AS_SHIPPED.settings() == {}
    steps = [step.step_m for step in LADDER]
    assert all(step is not None for step in steps)
    assert steps == sorted(steps, key=lambda step: -(step or 0.0))
    newton = LADDER[0].settings()["newton"]
    assert newton["velocity_tol"] == pytest.approx(1e-6 / FRAME_S)
    assert newton["semi_implicit"] == {"enable": 0}


@pytest.mark.parametrize(
    ("indenter", "device", "named"),
    [(_BODY, "cpu", "GPU"), (_BODY, "cuda:0", "pip install pyuipc")],
)
def test_absence_is_said(
    indenter: Cylinder, device: str, named: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a GPU, or without the package, a line says so, with how to install it."""
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)
    assert named in why_no_libuipc(replace(_SCENE, indenter=indenter), device=device)


def test_only_cylinders_are_pressed(monkeypatch: pytest.MonkeyPatch) -> None:
    """A ball is refused in words; a cylinder on a GPU with the package is not."""
    monkeypatch.setattr("importlib.util.find_spec", lambda name: name)
    ball = replace(_SCENE, indenter=Sphere(diameter_m=6e-3))
    assert "cylinders" in why_no_libuipc(ball, device="cuda:0")
    assert why_no_libuipc(_SCENE, device="cuda:0") == ""


def test_a_peer_that_cannot_start_is_a_failed_row(task: PeerTask, tmp_path: Path) -> None:
    """Without libuipc, or without the backend asked for, the process says so, again and again."""
    press = partial(press_in_libuipc, task, folder=str(tmp_path), backend="absent")
    with OwnProcess() as process:
        for _ in range(2):
            with pytest.raises(ProcessFailedError, match=r"uipc|absent|status"):
                process.call(press, limit_s=60.0)


def test_the_table_sets_force_and_balance_beside_every_time() -> None:
    """One row of ours for every count of the peer's; failed rows are empty and said."""
    ours = [_our_row(count, speed) for count, speed in ((1, 1000.0), (60, 20000.0), (256, 3e4))]
    balance = PeerBalance(
        force_n=6.0,
        imbalance=0.11,
        residual=0.2,
        inner_residual=0.1,
        gap_m=2e-5,
        depth_error_m=-1e-6,
    )
    shipped = PeerRow(
        mesh=PeerMesh.CORNERS.value,
        tolerance=AS_SHIPPED.name,
        environments=1,
        tet_count=2000,
        unknown_count=1206,
        version="0.0.29",
        wall_s=0.2,
        newton_iterations=4.0,
        force_error=0.3,
        balance=balance,
    )
    matched = replace(shipped, tolerance=LADDER[0].name, is_matched=True, wall_s=0.4)
    failed = replace(shipped, environments=60, balance=None, failure="out of memory")
    table = peer_table(ours, [shipped, matched, failed])
    assert [row[2] for row in table.rows] == [1, 60, 1, 1, 60]
    assert all(len(row) == len(table.columns) for row in table.rows)
    faster = table.columns.index("ours over it")
    assert [row[faster] for row in table.rows] == [1.0, 1.0, 10.0, 20.0, None]
    assert table.rows[2][table.columns.index("imbalance")] == 0.11
    assert str(table.rows[3][1]).endswith("*")
    assert "out of memory" in table.note
    assert not shipped.balances_to(BALANCE)


def _our_row(count: int, speed: float) -> BatchRow:
    return BatchRow(
        device="a GPU",
        environments=count,
        tet_count=500,
        unknown_count=2294,
        setup_s=1.0,
        wall_s=FRAME_COUNT * count / speed,
        evaluations=20.0,
        force_error=0.02,
        imbalance=1e-5,
        residual=1e-5,
        gap_m=2e-5,
        failed_count=0,
        stress=StressTimes(face_count=200, device_s=1e-5, host_s=1e-4),
        parts_s={},
    )


def _volumes(mesh: TetMesh) -> FloatArray:
    corners = mesh.vertices[mesh.tets]
    return np.asarray(np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6.0)
