"""A scene pressed in frames; no time is judged."""

from __future__ import annotations

from dataclasses import replace

import pytest

from sim.press import press
from sim.scene.scene import Preset
from sim.studies.bench.press import (
    moves,
    press_in_frames,
    press_scene,
    stated_scene,
    within,
)
from sim.studies.bench.scenes import FRAME_COUNT, Manner, select_scenes
from tacauchy_rig.core.errors import ConfigError


def test_frames_end_where_one_press_does() -> None:
    """Twenty frames, the force of one press to the same depth, in balance."""
    (line,) = select_scenes("ball, shallow")
    scene = replace(stated_scene(line.stated), preset=Preset.FAST, refinement=0.7)
    found = press_in_frames(scene, is_timed=False)
    alone = press(scene)
    assert found.force_n[2] == pytest.approx(alone.force_n[2], rel=1e-5)
    assert found.depth_m == pytest.approx(scene.target.depth_m)
    assert found.iterations >= FRAME_COUNT
    assert found.balance < 1e-5
    assert found.stiffness_n_m > 0.0


def test_a_corrected_scene_ends_on_its_own_mesh() -> None:
    """Frames on the way's mesh, and the end that ``press`` finds."""
    shallow = stated_scene(select_scenes("shallow")[0].stated)
    scene, is_stated = within(shallow, "5%", corrected=True)
    found, alone = press_in_frames(scene, is_timed=False), press(scene)
    assert is_stated
    assert found.corrected is not None
    assert alone.corrected is not None
    assert found.force_n[2] == pytest.approx(alone.force_n[2], rel=2e-3)
    assert found.corrected.force_n == pytest.approx(alone.corrected.force_n, rel=2e-3)
    assert found.tet_count == alone.tet_count


def test_a_motion_takes_half_of_the_frames() -> None:
    """Down in ten, then along in ten; straight presses go down in all."""
    sliding, straight = (
        stated_scene(select_scenes(name)[0].stated) for name in ("sliding", "shallow")
    )
    assert len(moves(sliding)) == len(moves(straight)) == FRAME_COUNT
    held = _Recorder()
    for move in moves(sliding):
        move(held)  # type: ignore[arg-type]
    assert held.pushed_n == pytest.approx([0.1 * k for k in range(1, 11)])
    assert sum(held.shifted_m) == pytest.approx(0.3e-3)
    assert len(held.shifted_m) == FRAME_COUNT // 2


class _Recorder:
    """Takes the moves of a path and remembers them."""

    def __init__(self) -> None:
        self.pushed_n: list[float] = []
        self.shifted_m: list[float] = []

    def push(self, force_n: float, *, duration_s: float) -> None:
        assert duration_s > 0.0
        self.pushed_n.append(force_n)

    def carry(self, *, shift_m: tuple[float, float], **_others: object) -> None:
        self.shifted_m.append(shift_m[0])


def test_a_tolerance_that_nothing_promises_still_chooses() -> None:
    """A promised setting is said to be; where none is, the preset is as fine as is usual."""
    straight = stated_scene(select_scenes("punch, rounded")[0].stated)
    assert within(straight, "5%")[1]
    scene, is_promised = within(straight, "0.01%")
    assert not is_promised
    assert scene.preset is Preset.ACCURATE
    with pytest.raises(ConfigError, match="--tolerance"):
        within(straight, "5")


@pytest.mark.slow
def test_a_batch_presses_the_scene_too() -> None:
    """Friction and all: the first environment's force is that of the press alone."""
    stated = {"indenter": "sphere:diameter=10mm", "depth": "0.1mm", "contact": "friction:0.5"}
    alone = press_in_frames(within(stated_scene(stated), "5%")[0])  # on the batch's mesh
    one, two = (press_scene(stated, Manner(environments=count)) for count in (1, 2))
    assert one.force_n == pytest.approx(two.force_n, rel=1e-4, abs=1e-6)
    assert two.force_n[2] == pytest.approx(alone.force_n[2], rel=5e-3)
    assert two.balance <= 1e-5
    assert two.setup_s < one.setup_s  # the pilot is shared
