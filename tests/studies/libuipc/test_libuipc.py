"""What libuipc is given of a scene, how its answers are judged, and its rows beside ours.

libuipc itself is not needed: what it would give is made by our own solver on its mesh.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from sim.scene.indenter import Plane
from sim.scene.material import LawName
from sim.scene.scene import ContactMode, Target
from sim.solve.loading_path import LoadingPath
from sim.studies.bench.scenes import FRAME_COUNT, all_scenes
from sim.studies.bench.timed_press import stated_scene, within
from tacauchy_rig.core.errors import ConfigError
from tests.studies.libuipc.command import press_in_peer
from tests.studies.libuipc.pad import PeerPad, PeerPresses, peer_pad
from tests.studies.libuipc.world import AS_SHIPPED

_DEPTH_M = 0.2e-3
_TAKEN = {"preset": AS_SHIPPED, "setup_s": 1.0, "wall_s": 0.1, "cpu_s": 0.4, "iterations": 8}


@pytest.fixture(scope="module")
def pad() -> PeerPad:
    """Return the pad of two layers as libuipc gets it, coarse, pressed 0.2 mm deep."""
    scene = within(stated_scene(all_scenes()["9DTact, two layers"]), "5%")[0]
    target = Target(depth_m=_DEPTH_M)
    return peer_pad(replace(scene, target=target, refinement=0.5 * scene.refinement))


def test_an_equilibrium_balances(pad: PeerPad) -> None:
    """Base against contact, by our law of both layers; a force a tenth too large is seen."""
    model, indenter = pad.model, pad.scene.indenter
    state = LoadingPath(model, indenter).advance(_DEPTH_M).state
    positions, tips_m = state.positions[None], state.tip[None]
    contact_n = -model.surface.scatter(
        model.surface.forces(state.positions, indenter, state).forces
    )[None]
    alone = PeerPresses(pad, 1)
    press = alone.judged(positions, contact_n, **_TAKEN)
    assert press.force_n[2] == pytest.approx(-contact_n[0, :, 2].sum(), rel=1e-4)
    assert press.balance < 1e-4
    assert press.depth_m == pytest.approx(_DEPTH_M)
    assert alone.strayed(tips_m) == []
    assert "3.0 um" in alone.strayed(tips_m + np.array([0.0, 0.0, 3e-6]))[0]
    wrong = alone.judged(positions, 1.1 * contact_n, **_TAKEN)
    assert wrong.balance == pytest.approx(0.1 / 1.1, rel=1e-3)
    assert math.isnan(alone.judged(positions, None, **_TAKEN).balance)
    # The other environment is stiffer: the same positions are no equilibrium of it.
    both = (np.repeat(each, 2, axis=0) for each in (positions, contact_n))
    assert PeerPresses(pad, 2).judged(*both, **_TAKEN).balance > 0.01


def test_libuipc_gets_the_whole_pad_with_its_layers(pad: PeerPad) -> None:
    """Linear tetrahedra fill it; the skin is stiffer by the tetrahedra; pads lie apart."""
    presses = PeerPresses(pad, 2)
    assert pad.model.volume_m3 == pytest.approx(28e-3 * 21e-3 * 4e-3, rel=1e-9)
    assert pad.model.elements.shape[1] == 4
    shear = np.unique(presses.shear_pa[0])
    assert shear[1] / shear[0] == pytest.approx(4.0)
    assert np.all(presses.shear_pa[1] > presses.shear_pa[0])
    apart = np.abs(np.subtract(*presses.origins_m)).max()
    assert apart > 2.0 * np.ptp(pad.model.nodes[:, 0])
    assert presses.poses.shape == (FRAME_COUNT, 2, 4, 4)
    assert presses.start[0, 2, 3] - presses.poses[-1, 0, 2, 3] == pytest.approx(_DEPTH_M)
    assert presses.poses[-1, 1, 2, 3] > presses.poses[-1, 0, 2, 3]


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
    scene = stated_scene(all_scenes()["punch, rounded"])
    law = change.pop("law", scene.material.law)
    scene = replace(scene, material=replace(scene.material, law=str(law)), **change)  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match=f"libuipc has no {named}"):
        peer_pad(scene)


def test_what_fails_is_a_row_and_the_next_goes_on() -> None:
    """What it cannot do is said, and where it is not installed every row says so."""
    scenes = {
        "flat": {"indenter": "plane", "depth": "0.1mm"},
        "ball": {"indenter": "sphere:diameter=10mm", "depth": "0.1mm"},
    }
    flat, ball = press_in_peer(scenes, (), {}, limit_s=60.0)
    assert {row.failure for row in flat} == {"libuipc has no unbounded plates"}
    assert [(bool(row.failure), row.press) for row in ball] == [(True, None)]
    assert ball[0].engine.endswith("step 1 um")
