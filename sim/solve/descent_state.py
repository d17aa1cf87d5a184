"""What the descents to equilibrium keep of every environment, on their device."""

from __future__ import annotations

from enum import IntEnum

import warp as wp


class Status(IntEnum):
    """What an environment is about: it runs, it is done, or it asks."""

    RUNNING = 0
    DONE = 1
    ASKS_START = 2  # the start is inside out or deep in the indenter
    ASKS_FACTOR = 3
    ASKS_SAFER_FACTOR = 4
    ASKS_ROUNDING = 5
    TOO_NEAR = 6  # the barrier has to be extended less
    NOWHERE_DOWN = 7
    OUT_OF_STEPS = 8
    NOT_FINITE = 9
    IDLE = 10


class Mode(IntEnum):
    """What was evaluated, if anything."""

    BEGIN = 0  # the start
    TRY = 1  # a step
    HELD = 2  # no more than what points that are held anew change
    GO = 3  # nothing: a factor was given
    RECHECK = 4  # nothing: the rounding was given


class Act(IntEnum):
    """What is done next."""

    NOTHING = 0
    SOLVE = 1
    LOWER = 2  # the indenter, which touches nothing
    SHORTEN = 3
    BACK = 4  # to where the step began


@wp.struct
class Limits:
    """What all environments share.

    Attributes:
        overlap: That a step may end with [m].
        tip_step: Longest step of an indenter that is pushed [m].
        energy_scale: E times the volume [J].
        lags: Points hold on with a lagged pressure.
        keeps: There is no other factor: one that asks for it forgets what it learnt, and goes on.
        patience_steps: With a factor, after which it is renewed where the residual is still
        patience_shares: more than this share of the contact force.
    """

    overlap: wp.float64
    tip_step: wp.float64
    energy_scale: wp.float64
    lags: wp.bool
    keeps: wp.bool
    patience_steps: wp.vec3i
    patience_shares: wp.vec3d


@wp.struct
class Descent:
    """Where every environment is, shape [environment_count] each.

    Attributes:
        status: It runs, is done or asks.
        mode: What is evaluated.
        act: What is done next.
        wanted: 1 where the forces are to be evaluated.
        holding: 1 where points are held anew, with the mean of before and now where it is 2.
        learns: 1 where the step that was accepted is remembered; ``takes`` where any is accepted.
        pushed: 1 where the indenter is pushed with ``load`` [N], and its height is an unknown.
        touches: 1 where the factored gel holds the indenter.
        attempt: Of the factor: 0 exact, above ever safer.
        checked: 1 where the start was looked at.
        rough: 1 until the residual is small enough to tell whether gaps will do.
        steps: Taken; ``steps_max`` at most, ``since`` the last factor.
        tries: Of the step under way.
        evaluations: Of the forces.
        slot: Where the inverse finds what it is asked for.
        push: Force on the indenter [N].
        recorded: Residuals, the last of which are ``residuals`` [N], shape [..., 6].
        relative: Residual that is enough, over the contact force; ``floor`` is always enough [N].
        gap_least: Smallest gap that a state may end with [m].
        rounding: What rounding leaves of a residual [N]; negative where it is not known.
        energy: [J].
        slope: Gradient . direction where the step began [J].
        length: Of the direction, squared [m^2].
        fraction: Of the direction that is tried.
        residual: Norm of the gradient [N].
        vertical: The gradient's sum along z [N].
        scale: Contact force [N].
        gripped_at: Residual where lagged pressure was taken over last [N].
        grip_change: Of the friction limit when it was taken over last, over itself.
        ratio_min: Smallest volume ratio.
        gap_min: Smallest gap [m].
    """

    status: wp.array(dtype=wp.int32)
    mode: wp.array(dtype=wp.int32)
    act: wp.array(dtype=wp.int32)
    wanted: wp.array(dtype=wp.int32)
    holding: wp.array(dtype=wp.int32)
    takes: wp.array(dtype=wp.int32)
    learns: wp.array(dtype=wp.int32)
    pushed: wp.array(dtype=wp.int32)
    touches: wp.array(dtype=wp.int32)
    attempt: wp.array(dtype=wp.int32)
    checked: wp.array(dtype=wp.int32)
    rough: wp.array(dtype=wp.int32)
    steps: wp.array(dtype=wp.int32)
    steps_max: wp.array(dtype=wp.int32)
    since: wp.array(dtype=wp.int32)
    tries: wp.array(dtype=wp.int32)
    evaluations: wp.array(dtype=wp.int32)
    slot: wp.array(dtype=wp.int32)
    recorded: wp.array(dtype=wp.int32)
    residuals: wp.array2d(dtype=wp.float64)
    load: wp.array(dtype=wp.float64)
    push: wp.array(dtype=wp.vec3d)
    relative: wp.array(dtype=wp.float64)
    floor: wp.array(dtype=wp.float64)
    gap_least: wp.array(dtype=wp.float64)
    rounding: wp.array(dtype=wp.float64)
    energy: wp.array(dtype=wp.float64)
    slope: wp.array(dtype=wp.float64)
    length: wp.array(dtype=wp.float64)
    fraction: wp.array(dtype=wp.float64)
    residual: wp.array(dtype=wp.float64)
    vertical: wp.array(dtype=wp.float64)
    scale: wp.array(dtype=wp.float64)
    gripped_at: wp.array(dtype=wp.float64)
    grip_change: wp.array(dtype=wp.float64)
    ratio_min: wp.array(dtype=wp.float64)
    gap_min: wp.array(dtype=wp.float64)


@wp.struct
class Evaluated:
    """What an evaluation reads and gives, shape [environment_count, ...] each, nodal vectors flat.

    Attributes:
        positions: Of the nodes [m].
        tips: Of the indenter [m].
        elastic: Gradient of the gel's energy [N].
        contact: Contact's part of the gradient [N].
        energies: Of the elements [J].
        ratios: Their smallest volume ratios.
        touched: Energies of the contact points [J].
        gaps: Of the contact points [m].
        grip_change: Of the points' friction limits [N].
        grip_limit: The limits [N].
    """

    positions: wp.array2d(dtype=wp.float64)
    tips: wp.array(dtype=wp.vec3d)
    elastic: wp.array2d(dtype=wp.float64)
    contact: wp.array2d(dtype=wp.float64)
    energies: wp.array2d(dtype=wp.float64)
    ratios: wp.array2d(dtype=wp.float64)
    touched: wp.array2d(dtype=wp.float64)
    gaps: wp.array2d(dtype=wp.float64)
    grip_change: wp.array2d(dtype=wp.float64)
    grip_limit: wp.array2d(dtype=wp.float64)


@wp.struct
class Pull:
    """Further energy k (x - x0)^2 / 2 - F . (x - X) of every nodal coordinate, flat.

    Attributes:
        stiffness: k [N/m].
        towards: x0 [m].
        force: F [N].
        rest: X [m].
    """

    stiffness: wp.array(dtype=wp.float64)
    towards: wp.array(dtype=wp.float64)
    force: wp.array(dtype=wp.float64)
    rest: wp.array(dtype=wp.float64)
