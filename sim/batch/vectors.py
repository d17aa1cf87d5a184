"""The vectors of a batch on the device, environment by environment."""

# Device structures: Warp makes them, untyped.
# mypy: ignore-errors

from __future__ import annotations

from typing import Any

import warp as wp

from sim.device import Device

_EXACT = ("trials", "accepted", "before", "long_before", "forces")
_ROUGH = ("rates", "steps", "residuals", "directions", "preconditioned")


@wp.struct
class Vectors:
    """Over the unknowns, each of shape [environment_count, row_count or more].

    Attributes:
        trials: Displacements at which forces are evaluated [m].
        accepted: Those at which conjugate gradients began [m].
        before: Those of the last frame [m].
        long_before: Those of the frame before it [m].
        forces: Unbalanced forces [N].
        rates: Their change along the direction [N].
        steps: What conjugate gradients have found [m].
        residuals: What is left of the unbalanced forces [N].
        directions: Of conjugate gradients [m].
        preconditioned: The preconditioner's inverse times the scaled residuals.
    """

    trials: wp.array2d(dtype=wp.float64)
    accepted: wp.array2d(dtype=wp.float64)
    before: wp.array2d(dtype=wp.float64)
    long_before: wp.array2d(dtype=wp.float64)
    forces: wp.array2d(dtype=wp.float64)
    rates: wp.array2d(dtype=wp.float32)
    steps: wp.array2d(dtype=wp.float32)
    residuals: wp.array2d(dtype=wp.float32)
    directions: wp.array2d(dtype=wp.float32)
    preconditioned: wp.array2d(dtype=wp.float32)


def new_vectors(environment_count: int, row_count: int, device: Device) -> Any:
    """Return vectors that are zero."""
    vectors = Vectors()
    for names, kind in ((_EXACT, wp.float64), (_ROUGH, wp.float32)):
        for name in names:
            setattr(vectors, name, device.zeros((environment_count, row_count), kind))
    return vectors


def clear(vectors: Any) -> None:
    """Set all of them to zero."""
    for name in (*_EXACT, *_ROUGH):
        getattr(vectors, name).zero_()
