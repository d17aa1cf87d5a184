"""What the kernels keep of a batch's environments: where each is, its vectors, what it gives."""

from __future__ import annotations

from typing import Any

import warp as wp

from sim.device import Device

# What an environment is doing:
EVALUATE = wp.constant(0)  # its forces at a trial state are wanted
SEARCH = wp.constant(1)  # conjugate gradients look for its Newton step
WAIT = wp.constant(2)  # it has reached its last frame
FAILED = wp.constant(3)  # Newton gave up

# What is done with its vectors after an evaluation:
NOTHING = wp.constant(0)
START = wp.constant(1)  # begin conjugate gradients at the accepted state
ADVANCE_SEARCH = wp.constant(2)  # one step of conjugate gradients
END_SEARCH = wp.constant(3)  # the direction has no positive curvature: take what there is
SHORTEN = wp.constant(4)  # halve Newton's step
NEXT_FRAME = wp.constant(5)  # in balance: extrapolate to the next frame
GIVE_UP = wp.constant(6)
START_ANEW = wp.constant(7)  # Newton did not get there: begin the frame from another state


@wp.struct
class Limits:
    """When an environment's iterations end: numbers of ``BatchOptions``, and ``floor``.

    Attributes:
        floor: Residual norm that is always enough [N].
    """

    floor: wp.float64
    residual_relative: wp.float64
    forcing: wp.float64
    search_max: wp.int32
    newton_max: wp.int32
    halving_max: wp.int32
    retry_max: wp.int32
    lead_max: wp.int32
    growth_max: wp.float64


@wp.struct
class Progress:
    """Where every environment is; each array has shape [environment_count].

    Attributes:
        status: What it is doing.
        frame: Frames that are behind it.
        newton: Newton steps of this frame.
        searches: Steps of conjugate gradients of this Newton step.
        halvings: Of this Newton step.
        retries: Further starts of this frame.
        trying: 1 while a step is tried.
        fraction: Of the step that is tried.
        slope: Of the energy along the step [J].
        scaled: r . z of the last direction, and of the first.
        first_scaled: The latter.
        act: What an environment does after an evaluation.
        length: Of the step along the direction, while conjugate gradients advance.
        norm: Of the last forces [N].
        started: Of those at which conjugate gradients began [N].
        vertical: Sum of the last forces along z [N].
        push: Force on the indenter, modelled part [N].
        gap: The smallest [m].
        changed: 1 where the preconditioner has changed: a search's directions then begin anew.
        spent: Evaluations so far.
    """

    status: wp.array(dtype=wp.int32)
    frame: wp.array(dtype=wp.int32)
    newton: wp.array(dtype=wp.int32)
    searches: wp.array(dtype=wp.int32)
    halvings: wp.array(dtype=wp.int32)
    retries: wp.array(dtype=wp.int32)
    trying: wp.array(dtype=wp.int32)
    fraction: wp.array(dtype=wp.float64)
    slope: wp.array(dtype=wp.float64)
    scaled: wp.array(dtype=wp.float64)
    first_scaled: wp.array(dtype=wp.float64)
    act: wp.array(dtype=wp.int32)
    length: wp.array(dtype=wp.float64)
    norm: wp.array(dtype=wp.float64)
    started: wp.array(dtype=wp.float64)
    vertical: wp.array(dtype=wp.float64)
    push: wp.array(dtype=wp.vec3d)
    gap: wp.array(dtype=wp.float64)
    changed: wp.array(dtype=wp.int32)
    spent: wp.array(dtype=wp.int32)


@wp.func
def may_run(
    b: wp.int32, progress: Progress, limits: Limits, segment_end: wp.array(dtype=wp.int32)
) -> wp.bool:
    """Return whether the stiffness that preconditions is still near to an environment."""
    return progress.frame[b] < segment_end[0] + limits.lead_max


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


@wp.struct
class Found:
    """What every frame gives, each of shape [frame_count, environment_count].

    Attributes:
        push: Force on the indenter, modelled part [N].
        residual: Norm of the unbalanced force over the contact force.
        imbalance: Base reaction against the indenter's force, over the latter.
        gap: The smallest [m].
    """

    push: wp.array2d(dtype=wp.vec3d)
    residual: wp.array2d(dtype=wp.float64)
    imbalance: wp.array2d(dtype=wp.float64)
    gap: wp.array2d(dtype=wp.float64)


def zeroed(structure: Any, shape: int | tuple[int, ...], device: Device) -> Any:
    """Return one of the structures above, its arrays zero and all of one shape."""
    made = structure()
    for name, member in structure.vars.items():
        setattr(made, name, device.zeros(shape, member.type.dtype))
    return made


def clear(structure: Any, made: Any) -> None:
    """Set all arrays of a structure to zero."""
    for name in structure.vars:
        getattr(made, name).zero_()
