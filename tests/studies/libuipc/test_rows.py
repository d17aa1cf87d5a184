"""libuipc's rows and tables; where it is not installed, its absence is said."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from sim.studies.bench.scenes import BenchScene, Manner, SceneRow
from tacauchy_rig.core.errors import ConfigError
from tests.studies.libuipc import rows
from tests.studies.libuipc.libuipc import PeerWorld
from tests.studies.libuipc.rows import PeerRow, press_in_peer, refuse_without_libuipc
from tests.studies.libuipc.table import peer_tables
from tests.studies.libuipc.task import AS_SHIPPED, FRAME_S, STRICT, PeerFound, PeerTask

_BALL = {"indenter": "sphere:diameter=10mm", "depth": "0.1mm"}


def test_absence_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a GPU, or without the package, with how to install it."""
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)
    with pytest.raises(ConfigError, match="--device cpu"):
        refuse_without_libuipc("cpu")
    with pytest.raises(ConfigError, match="not installed") as refused:
        refuse_without_libuipc("cuda:0")
    assert "pip install pyuipc" in str(refused.value)


def test_strict_is_stricter_than_shipped() -> None:
    """As shipped changes nothing."""
    assert AS_SHIPPED.settings() == {}
    newton = STRICT.settings()["newton"]
    assert newton["velocity_tol"] == pytest.approx(1e-6 / FRAME_S)
    assert newton["semi_implicit"] == {"enable": 0}


def test_what_fails_is_a_row_and_the_next_goes_on() -> None:
    """Without libuipc, or its backend, every row says so; what it cannot do is not tried."""
    flat = BenchScene(name="flat", stated={"indenter": "plane", "depth": "0.1mm"})
    said: list[PeerRow] = []
    ball = BenchScene(name="ball", stated=_BALL)
    found = press_in_peer([flat, ball], (1,), limit_s=60.0, on_progress=said.append, backend="no")
    assert [[row.scene for row in each] for each in found] == [["flat"] * 2, ["ball"] * 2]
    assert {row.failure for row in said[:2]} == {"libuipc has no unbounded plates"}
    assert all(row.failure and row.press is None for row in said)
    assert [row.engine.split(", ")[1] for row in said[2:]] == ["as shipped", "step 1 um"]


def test_rows_stand_beside_ours(monkeypatch: pytest.MonkeyPatch) -> None:
    """As many environments beside as many; a failure says why in its row; remarks are told."""
    monkeypatch.setattr(rows, "press_in_libuipc", _pressed)
    monkeypatch.setattr(rows, "IsolatedWorker", _Here)
    scenes = [BenchScene(name=name, stated=_BALL) for name in ("one", "two")]
    found = press_in_peer(scenes, (1, 2), limit_s=60.0, on_progress=lambda _row: None)
    peers = tuple(zip(*found, strict=True))
    assert [rows_[0].manner.environments for rows_ in peers] == [1, 2, 1]
    press = peers[0][0].press
    assert press is not None
    ours = SceneRow(
        scene="one",
        manner=Manner(device="cuda:0", environments=1),
        press=replace(press, wall_s=0.1 * press.wall_s),
    )
    failed = replace(peers[0][1], press=None, failure="not done after 60 s")
    first, second, _ = peer_tables([[ours]], {}, [(peers[0][0], failed), *peers[1:]])
    ratio, theirs = (first.columns.index(name) for name in ("ours over it", "libuipc [1/s]"))
    assert first.rows[0][ratio] == "10"
    assert first.rows[1][theirs] == "not done after 60 s"
    assert second.rows[0][ratio] is None
    assert "one: a remark." in first.note


class _Here:
    """Calls in this process."""

    def __enter__(self) -> _Here:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def call(self, function: partial[PeerFound], *, limit_s: float) -> PeerFound:
        assert limit_s > 0.0
        return function()


def _pressed(task: PeerTask, *, folder: str, backend: str) -> PeerFound:
    """Return what a libuipc would give that moves nothing."""
    assert (bool(folder), backend) == (True, "cuda")
    return PeerFound(
        set_up_s=1.0,
        press_s=((1.0, 1.0),),
        newton_iterations=(1,) * 20,
        positions=np.repeat(task.nodes[None], task.count, axis=0),
        tips_m=task.poses[-1, :, :3, 3],
        contact_n=None,
        problems=("a remark",),
    )


def test_indenters_are_told_where_to_go() -> None:
    """Aims are those of the frame, each in its pad's place of the scene."""
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[:, 2, 3] = (1.0, 2.0)
    aims, constrained = np.zeros((2, 4, 4)), np.zeros(2)
    names = SimpleNamespace(is_constrained="on", aim_transform="aim")
    world = SimpleNamespace(
        uipc=SimpleNamespace(view=lambda array: array, builtin=names),
        task=SimpleNamespace(origins_m=np.array([[5.0, 0.0, 0.0], [0.0, 6.0, 0.0]])),
        aims=poses,
    )
    world._placed = partial(PeerWorld._placed, world)  # type: ignore[arg-type]
    instances = {"on": constrained, "aim": aims}
    slot = SimpleNamespace(
        geometry=lambda: SimpleNamespace(instances=lambda: SimpleNamespace(find=instances.get))
    )
    PeerWorld._move(world, SimpleNamespace(geo_slots=lambda: [slot]))  # type: ignore[arg-type]
    assert constrained.tolist() == [1.0, 1.0]
    assert aims[:, :3, 3].tolist() == [[5.0, 0.0, 1.0], [0.0, 6.0, 2.0]]
