"""Unlike presses in one batch: what is drawn, and the row that is measured."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim.press_arguments import scene_from
from sim.scene.pad import BoxPad
from sim.studies.bench import sensor_batches as unlike

PAD = BoxPad(size_x_m=12e-3, size_y_m=10e-3, height_m=3e-3)


def test_drawn_poses_lie_on_the_pad() -> None:
    """Within its margin, no deeper than two fifths of its height, tilted by 15 degrees at most."""
    of = unlike.unlike_bodies()
    which, poses = unlike.draw_poses(PAD, of, 300, seed=7)
    assert set(which.tolist()) == set(range(len(of)))
    assert np.abs(poses[:, 0]).max() <= 3e-3 + 1e-12
    depth = PAD.height_m - poses[:, 2]
    assert 0.0 < depth.min() < depth.max() <= 0.4 * PAD.height_m + 1e-12
    assert depth[which == 0].max() <= 0.45 * 2e-3 + 1e-12
    assert np.degrees(Rotation.from_quat(poses[:, 3:]).magnitude()).max() <= 15.0 + 1e-9
    again, same = unlike.draw_poses(PAD, of, 300, seed=7)
    assert np.array_equal(which, again)
    assert np.array_equal(poses, same)


@pytest.mark.slow
def test_a_row_counts_what_was_found() -> None:
    """Two presses on a coarse mesh."""
    scene = scene_from("--sensor gelsight-mini --indenter plane --depth 0.1mm")
    rows = list(unlike.measure_unlike(scene, count=2, edges_m=(3e-3,)))
    assert len({row["friction"] for row in rows}) == len(rows) == 2
    for row in rows:
        assert row["found"] == row["presses"] == 2
        assert row["with image, height map, tractions [s]"] > row["presses [s]"] > 0.0
        assert unlike.unlike_table([row]).passed
        assert not unlike.unlike_table([{**row, "found": 1}]).passed


@pytest.mark.slow
def test_a_batch_is_held_against_presses_alone() -> None:
    """A ball on a pad: the row counts it, and a force that is far off does not pass."""
    scene = scene_from(
        "--pad box:12x10x3mm --young 0.1MPa --poisson 0.45 --indenter plane --depth 0.1mm"
    )
    (row,) = unlike.measure_alone(scene, count=1, edges_m=(2e-3,), tolerance=0.1)
    assert row["found"] == 1
    assert abs(row["F_z off, median [%]"]) < 20.0
    assert unlike.alone_table([{**row, unlike.WITHIN: 100.0}]).passed
    assert not unlike.alone_table([{**row, unlike.WITHIN: 50.0}]).passed
