"""Case 13: what is rewritten to single precision."""

from __future__ import annotations

from sim.studies.hard_cases.precision import in_single_precision


def test_single_precision_source_has_no_double_left() -> None:
    """Case 13: types of the kernels change, those of the host do not."""
    source = "x: wp.array(dtype=wp.vec3d) = wp.mat33d(wp.float64(0.0)); np.float64; wp.array2d"
    single = "x: wp.array(dtype=wp.vec3f) = wp.mat33f(wp.float32(0.0)); np.float64; wp.array2d"
    assert in_single_precision(source) == single
