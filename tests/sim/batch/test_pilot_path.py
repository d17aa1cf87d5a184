"""Where on the pilot's path a step of an environment is."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from sim.batch.pilot_path import PilotPath, path_positions
from sim.device import Device

_CPU = Device("cpu")
# Down in two parts, then along x in two; once more along x from half way down the second.
_POINTS = np.array(
    [[0, 0, 0], [0, 0, 1], [0, 0, 2], [1, 0, 2], [2, 0, 2], [0, 0, 1.5], [1, 0, 1.5]]
)
_BEFORE = [0, 0, 1, 2, 3, 1, 5]
_STATES = [-1, 0, 1, 2, 3, -1, 4]


@wp.kernel(enable_backward=False)
def _find(
    path: PilotPath,
    before: wp.vec4d,
    after: wp.vec4d,
    places_out: wp.array(dtype=wp.float64),
    nearest_out: wp.array(dtype=wp.int32),
):
    began, ends, nearest = path_positions(path, before, after)
    places_out[0] = wp.float64(began.point - 1) + began.share
    places_out[1] = wp.float64(ends.point - 1) + ends.share
    nearest_out[0] = nearest


def found(before: list[float], after: list[float]) -> tuple[list[float], int]:
    """Return where a step begins and ends, in segments of the path, and the state near its end."""
    tables = {
        "coordinates": 1e-3 * np.column_stack([_POINTS, np.zeros(len(_POINTS))]),
        "motions": np.zeros((len(_POINTS), 1, 3)),
        "depths": 1e-3 * _POINTS[:, 2],
        "states": np.array(_STATES),
        "before": np.array(_BEFORE),
        "frames": np.arange(max(_STATES) + 1),
    }
    places, nearest = _CPU.zeros(2, wp.float64), _CPU.zeros(1, wp.int32)
    ends = [wp.vec4d(*(1e-3 * np.array(each))) for each in (before, after)]
    wp.launch(
        _find,
        1,
        inputs=[_CPU.tables(PilotPath, tables), *ends],
        outputs=[places, nearest],
        device="cpu",
    )
    return places.numpy().tolist(), int(nearest.numpy()[0])


@pytest.mark.parametrize(
    ("before", "after", "places", "nearest"),
    [
        ([0, 0, 0, 0], [0, 0, 0.9, 0], [0.0, 0.9], 0),
        ([0, 0, 0.9, 0], [0, 0, 1.8, 0], [0.9, 1.8], 1),
        # Less deep than the pilot, the corner is cut: the step is the pilot's after it.
        ([0, 0, 1.9, 0], [0.3, 0, 1.9, 0], [2.0, 2.3], 2),
        ([0, 0, 1.9, 0], [0.9, 0, 1.9, 0], [2.0, 2.9], 2),
        # Nearer to the branch; where it leaves, no state is kept.
        ([0, 0, 1.4, 0], [0.3, 0, 1.4, 0], [5.0, 5.3], 4),
        ([0, 0, 1.1, 0], [0, 0, 1.6, 0], [1.1, 1.6], 1),
        # From corner to corner.
        ([0, 0, 1, 0], [0, 0, 2, 0], [1.0, 2.0], 1),
        ([0, 0, 2, 0], [1, 0, 2, 0], [2.0, 3.0], 2),
    ],
)
def test_a_step_is_where_the_pilot_went_its_way(
    before: list[float], after: list[float], places: list[float], nearest: int
) -> None:
    """A step along a part of the way is there, however near another part is."""
    at, state = found(before, after)
    assert at == pytest.approx(places, abs=1e-9)
    assert state == nearest


def test_a_step_that_the_pilot_never_went_is_nowhere() -> None:
    """Along y: both places are the first, and the nearest inverse is told all the same."""
    assert found([0, 0, 2, 0], [0, 1, 2, 0]) == ([0.0, 0.0], 1)
