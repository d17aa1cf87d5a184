"""What an environment of a batch is doing, as the kernels know it."""

# Device constants: Warp makes them, untyped.
# mypy: ignore-errors

from __future__ import annotations

import warp as wp

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
