"""All hard cases with their criteria, in the order of their numbers."""

from __future__ import annotations

from collections.abc import Collection

from sim.studies.hard_cases import (
    compression,
    dynamics,
    materials,
    places,
    precision,
    presses,
    refinement,
    sliding,
    starts,
    units,
)
from sim.studies.hard_cases.case import HardCase
from tacauchy_rig.errors import ConfigError

CASES = (
    HardCase(
        number=1,
        name="collapsed, flattened and mirrored starts",
        criterion="back to rest to 1e-6 of the height in at most 20 iterations",
        measure=starts.degenerate_starts,
    ),
    HardCase(
        number=2,
        name="random start",
        criterion="no NaN, energy never rises, ends stationary, and the state is reported",
        measure=starts.random_start,
    ),
    HardCase(
        number=3,
        name="nu from 0.45 to 0.499",
        criterion="F within 5 % of Hayes et al. (1972)",
        measure=materials.nearly_incompressible,
        limit_s=120.0,
    ),
    HardCase(
        number=4,
        name="80 % compression",
        criterion="every frame converged, F monotone, min J reported",
        measure=compression.deep_presses,
    ),
    HardCase(
        number=5,
        name="sharp rim moved by half an element",
        criterion="F varies by less than 5 %",
        measure=places.moved_rim,
    ),
    HardCase(
        number=6,
        name="time step 10 us to 1 s, and the whole depth in one step",
        criterion="the quasi-static F_z is the same to 1e-3",
        measure=dynamics.time_steps,
    ),
    HardCase(
        number=7,
        name="slivers of 0.5 deg",
        criterion="converged in at most 3 times the iterations of the mesh without them",
        measure=materials.slivers,
        limit_s=120.0,
    ),
    HardCase(
        number=8,
        name="layers of stiffness ratio 1e4",
        criterion="residual < 1e-6 F, F within 5 % of the laminate's",
        measure=materials.stiff_layers,
        limit_s=120.0,
    ),
    HardCase(
        number=9,
        name="stick and slip",
        criterion="|Ft| <= mu Fn (1 + 1e-3) at every step, creep below eps_v dt",
        measure=sliding.stick_slip,
    ),
    HardCase(
        number=10,
        name="impact at 1, 2 and 5 m/s",
        criterion="every gap stays positive, and energy does not grow beyond the indenter's work",
        measure=dynamics.impact,
    ),
    HardCase(
        number=11,
        name="torsion by 180 deg",
        criterion="torque without a kink of over 5 % of its maximum in 10 deg, min J > 0",
        measure=sliding.torsion,
    ),
    HardCase(
        number=12,
        name="units of length and stress scaled by 1e-3 to 1e3",
        criterion="positions and forces are the same to 1e-8 of the largest",
        measure=units.scaled_units,
    ),
    HardCase(
        number=13,
        name="float32 kernels against float64",
        criterion="F_z to 1e-3 with a barrier distance of 10 um, and the stall is flagged",
        measure=precision.single_precision,
        limit_s=400.0,
    ),
    HardCase(
        number=14,
        name="no contact",
        criterion="exactly zero force in exactly zero iterations",
        measure=presses.no_contact,
    ),
    HardCase(
        number=15,
        name="start in penetration",
        criterion="resolved with the force of a press to 1e-6, or refused with a message",
        measure=starts.penetrating_start,
    ),
    HardCase(
        number=16,
        name="indenter half off the pad, on a corner, fully off",
        criterion="half off and on a corner: converged at every step, force balance <= 1e-6, "
        "gap > 0, F_z rising and smaller than in the middle; fully off: refused before it is "
        "pressed, by a message that says where the pad ends",
        measure=places.off_the_pad,
        limit_s=600.0,
    ),
    HardCase(
        number=17,
        name="rigid motion, patch test and refinement",
        criterion="exact to 1e-10; order about 1 at a sharp rim (P1), at least 1.8 (sphere, P2)",
        measure=refinement.consistency_and_order,
        limit_s=600.0,
    ),
    HardCase(
        number=18,
        name="balance of forces, gaps and friction's dissipation",
        criterion="the indenter's force is the base's reaction to 1e-6, every gap is positive, "
        "friction dissipates at least 0",
        measure=presses.force_balance,
    ),
    HardCase(
        number=19,
        name="run again",
        criterion="the same result, in this process and in another",
        measure=presses.repeatable,
    ),
)


def select_cases(numbers: Collection[int]) -> tuple[HardCase, ...]:
    """Return the cases of these numbers; all of them where none is given.

    Raises:
        ConfigError: There is no case of such a number.
    """
    known = [case.number for case in CASES]
    unknown = sorted(set(numbers) - set(known))
    if unknown:
        raise ConfigError(
            f"--rows: there is no hard case {', '.join(map(str, unknown))}",
            remedy=f"choose among {', '.join(map(str, known))}",
        )
    return tuple(case for case in CASES if not numbers or case.number in numbers)
