"""What the descents to equilibrium keep of every environment, on their device."""

from enum import IntEnum

import warp as wp


class Status(IntEnum):
    """What an environment is about: it runs, it is done, or it asks."""

    RUNNING = 0
    DONE = 1
    ASKS_START = 2  # the start is inside out or deep in the indenter
    ASKS_FACTOR = 3
    ASKS_SAFER_FACTOR = 4
    TOO_NEAR = 5  # the barrier has to be extended less
    NO_DESCENT = 6
    OUT_OF_STEPS = 7
    NOT_FINITE = 8


class Mode(IntEnum):
    """What was evaluated, if anything."""

    BEGIN = 0  # the start
    TRY = 1  # a step
    HELD = 2  # no more than what points that are held anew change
    GO = 3  # nothing: a factor was given


class Act(IntEnum):
    """What is done next."""

    NOTHING = 0
    SOLVE = 1
    SHORTEN = 2
    BACK = 3  # to where the step began


@wp.struct
class Limits:
    """What all environments share."""

    overlap: wp.float64  # that a step may end with [m]
    tip_step: wp.float64  # longest step of an indenter that is pushed [m]
    energy_scale: wp.float64  # E times the volume [J]
    lags: wp.bool  # points hold on with a lagged pressure
    holds_until: wp.int32  # after so many steps it may be left as it is
    # there is no other factor: one that asks for it forgets what it learnt, and goes on
    keeps: wp.bool
    # after so many steps a factor is renewed where the residual is still more than this share of
    # the contact force
    patience_steps: wp.vec3i
    patience_shares: wp.vec3d


@wp.struct
class Descent:
    """Where every environment is, shape [environment_count] each."""

    status: wp.array(dtype=wp.int32)  # it runs, is done or asks
    mode: wp.array(dtype=wp.int32)  # what is evaluated
    act: wp.array(dtype=wp.int32)  # what is done next
    wanted: wp.array(dtype=wp.int32)  # 1 where the forces are to be evaluated
    # n where points are held anew, with 1/n of what their pressure changes by
    holding: wp.array(dtype=wp.int32)
    damping: wp.array(dtype=wp.int32)  # this n with an inverse that is never made anew
    takes: wp.array(dtype=wp.int32)
    # 1 where the step that was accepted is remembered; ``takes`` where any is accepted
    learns: wp.array(dtype=wp.int32)
    # 1 where the indenter is pushed with ``load`` [N], and its height is an unknown
    pushed: wp.array(dtype=wp.int32)
    attempt: wp.array(dtype=wp.int32)  # of the factor: 0 exact, above ever safer
    checked: wp.array(dtype=wp.int32)  # 1 where the start was looked at
    # 1 until the residual is small enough to tell whether gaps will do
    rough: wp.array(dtype=wp.int32)
    steps: wp.array(dtype=wp.int32)  # taken; ``steps_max`` at most, ``since`` the last factor
    steps_max: wp.array(dtype=wp.int32)
    since: wp.array(dtype=wp.int32)
    tries: wp.array(dtype=wp.int32)  # of the step under way
    evaluations: wp.array(dtype=wp.int32)  # of the forces
    slot: wp.array(dtype=wp.int32)  # where the inverse finds what it is asked for
    # residuals, the last of which are ``residuals`` [N], shape [..., 6]
    recorded: wp.array(dtype=wp.int32)
    residuals: wp.array2d(dtype=wp.float64)
    load: wp.array(dtype=wp.float64)
    push: wp.array(dtype=wp.vec3d)  # force on the indenter [N]
    # residual that is enough, over the contact force; ``floor`` is always enough [N]
    relative: wp.array(dtype=wp.float64)
    floor: wp.array(dtype=wp.float64)
    gap_least: wp.array(dtype=wp.float64)  # smallest gap that a state may end with [m]
    rounding: wp.array(dtype=wp.float64)  # what it leaves of a residual [N]
    energy: wp.array(dtype=wp.float64)  # [J]
    slope: wp.array(dtype=wp.float64)  # gradient . direction where the step began [J].
    length: wp.array(dtype=wp.float64)  # of the direction, squared [m^2]
    fraction: wp.array(dtype=wp.float64)  # of the direction that is tried
    first_try: wp.array(dtype=wp.float64)  # the one with which the next step begins
    residual: wp.array(dtype=wp.float64)  # norm of the gradient [N]
    vertical: wp.array(dtype=wp.float64)  # the gradient's sum along z [N]
    scale: wp.array(dtype=wp.float64)  # contact force [N]
    gripped_at: wp.array(dtype=wp.float64)  # residual where lagged pressure was taken over last [N]
    # of the friction limit when it was taken over last, over itself
    grip_change: wp.array(dtype=wp.float64)
    ratio_min: wp.array(dtype=wp.float64)  # smallest volume ratio
    gap_min: wp.array(dtype=wp.float64)  # smallest gap [m]


@wp.struct
class Evaluated:
    """What an evaluation reads and gives, [environment_count, ...] each, nodal vectors flat."""

    positions: wp.array2d(dtype=wp.float64)  # of the nodes [m]
    tips: wp.array(dtype=wp.vec3d)  # of the indenter [m]
    elastic: wp.array2d(dtype=wp.float64)  # gradient of the gel's energy [N]
    contact: wp.array2d(dtype=wp.float64)  # contact's part of the gradient [N]
    energies: wp.array2d(dtype=wp.float64)  # of the elements [J]
    ratios: wp.array2d(dtype=wp.float64)  # their smallest volume ratios
    touched: wp.array2d(dtype=wp.float64)  # energies of the contact points [J]
    gaps: wp.array2d(dtype=wp.float64)  # of the contact points [m]
    grip_change: wp.array2d(dtype=wp.float64)  # of the points' friction limits [N]
    grip_limit: wp.array2d(dtype=wp.float64)  # the limits [N]


@wp.struct
class Pull:
    """Further energy k (x - x0)^2 / 2 - F . (x - X) of every nodal coordinate, flat."""

    stiffness: wp.array(dtype=wp.float64)  # k [N/m]
    towards: wp.array(dtype=wp.float64)  # x0 [m]
    force: wp.array(dtype=wp.float64)  # F [N]
    rest: wp.array(dtype=wp.float64)  # X [m]
