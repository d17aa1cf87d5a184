"""Row 4: a 5 mm cylinder pressed in by 80 % of the pad's height.

Gel that sticks may still lift off, and that bounds what is monotone: under a sharp rim resolved by
0.1 mm and 16 sectors instead of 0.2 mm and 8, a ring of it peels at 76 %, is squeezed out past the
rim, and F falls from 46 to 38 N before it rises again. Where gel slips freely on a sharp rim, F
falls too, between 65 and 70 % on a rim of 0.1 mm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.contact.state import ContactOptions
from sim.scene.indenter import Cylinder
from sim.scene.material import LawName
from sim.solve.load_steps.path import LoadingPath
from sim.studies.hard_cases.case import Measured, Outcome
from sim.studies.hard_cases.pads import BARRIER_M, HEIGHT_M, pad_model, round_mesh

_DEPTH_SHARE = 0.8
_STEP_M = 0.1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class DeepPress:
    """One way to press a disc pad, 20 mm wide and 4 mm high, with a 5 mm cylinder.

    Attributes:
        fillet_m: Of the cylinder's rim [m]; 0 is sharp.
        bonded: The gel sticks to it; otherwise it slips freely.
        size_m: Edge length at the rim [m].
        growth: Ratio of neighbouring edge lengths away from it.
        sector_count: Sectors of a full turn.
    """

    name: str
    fillet_m: float
    bonded: bool
    size_m: float = 0.2e-3
    growth: float = 2.0
    sector_count: int = 8
    law: LawName = LawName.STABLE_NEO_HOOKEAN


# The stable law costs little at J = 0, and at a sharp rim it goes below; the other one cannot.
_PRESSES = (
    DeepPress(
        name="rounded_slipping",
        fillet_m=0.5e-3,
        bonded=False,
        size_m=0.25e-3,
        growth=1.5,
        sector_count=12,
    ),
    DeepPress(name="rounded_sticking", fillet_m=0.5e-3, bonded=True),
    DeepPress(
        name="sharp_sticking",
        fillet_m=0.0,
        bonded=True,
        law=LawName.NEO_HOOKEAN,
    ),
)


def deep_presses() -> Outcome:
    """Press in 0.1 mm frames to 80 % of the height, in three ways."""
    outcomes = [press_in(case) for case in _PRESSES]
    measured: Measured = {}
    for outcome in outcomes:
        measured |= outcome.measured
    return Outcome(passed=all(outcome.passed for outcome in outcomes), measured=measured)


def press_in(case: DeepPress) -> Outcome:
    """Press to 80 % of the height, frame by frame.

    Raises:
        ConvergenceError: A frame has no equilibrium.
    """
    indenter = Cylinder(diameter_m=5e-3, fillet_m=case.fillet_m)
    mesh = round_mesh(
        start_m=indenter.radius_m - case.fillet_m,
        end_m=indenter.radius_m,
        size_m=case.size_m,
        growth=case.growth,
        sector_count=case.sector_count,
    )
    options = ContactOptions(distance_m=BARRIER_M, bonded=case.bonded)
    model = pad_model(mesh, law_name=case.law, contact_options=options)
    path = LoadingPath(model, indenter, step_max_m=_STEP_M)
    forces, ratios = [0.0], [1.0]
    depth = _DEPTH_SHARE * HEIGHT_M
    for at in np.linspace(0.0, depth, round(depth / _STEP_M) + 1)[1:]:
        point = path.advance(float(at))
        forces.append(float(point.force_n[2]))
        ratios.append(point.equilibrium.min_jacobian)
    rise = float(np.diff(forces).min())
    return Outcome(
        passed=rise > 0.0,
        measured={
            f"force_end_{case.name}_n": forces[-1],
            f"force_rise_min_{case.name}_n": rise,
            f"min_jacobian_{case.name}": min(ratios),
            f"newton_iterations_{case.name}": path.counts.newton_iterations,
        },
    )
