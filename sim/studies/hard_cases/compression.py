"""Row 4: a 5 mm cylinder pressed in by 80 % of the pad's height.

Gel that sticks may still lift off, and that bounds what is monotone: under a sharp rim resolved by
0.1 mm and 16 sectors instead of 0.2 mm and 8, a ring of it peels at 76 %, is squeezed out past the
rim, and F falls from 46 to 38 N before it rises again. Where gel slips freely on a sharp rim, F
falls too, between 65 and 70 % on a rim of 0.1 mm.
"""

from __future__ import annotations

import numpy as np

from sim.contact.state import ContactOptions
from sim.scene.indenter import Cylinder
from sim.scene.material import LawName
from sim.solve.loading_path import LoadingPath
from sim.studies.hard_cases.case import Measured, Outcome
from sim.studies.hard_cases.pads import BARRIER_M, HEIGHT_M, pad_model, round_mesh

_DEPTH_SHARE = 0.8
_STEP_M = 0.1e-3


def deep_presses() -> Outcome:
    """Press in 0.1 mm frames to 80 % of the height, in three ways."""
    # The stable law costs little at J = 0, and at a sharp rim it goes below; the other one cannot.
    outcomes = [
        press_in(
            "rounded_slipping",
            fillet_m=0.5e-3,
            bonded=False,
            size_m=0.25e-3,
            growth=1.5,
            sector_count=12,
        ),
        press_in("rounded_sticking", fillet_m=0.5e-3, bonded=True),
        press_in("sharp_sticking", fillet_m=0.0, bonded=True, law_name=LawName.NEO_HOOKEAN),
    ]
    measured: Measured = {}
    for outcome in outcomes:
        measured |= outcome.measured
    return Outcome(passed=all(outcome.passed for outcome in outcomes), measured=measured)


def press_in(
    name: str,
    *,
    fillet_m: float,
    bonded: bool,
    size_m: float = 0.2e-3,
    growth: float = 2.0,
    sector_count: int = 8,
    law_name: LawName = LawName.STABLE_NEO_HOOKEAN,
) -> Outcome:
    """Press a disc pad, 20 mm wide, to 80 % of its 4 mm with a 5 mm cylinder, frame by frame.

    Args:
        name: In the names of what is measured.
        fillet_m: Of the cylinder's rim [m]; 0 is sharp.
        bonded: The gel sticks to it; otherwise it slips freely.
        size_m: Edge length at the rim [m].
        growth: Ratio of neighbouring edge lengths away from it.
        sector_count: Sectors of a full turn.

    Raises:
        ConvergenceError: A frame has no equilibrium.
    """
    indenter = Cylinder(diameter_m=5e-3, fillet_m=fillet_m)
    mesh = round_mesh(
        start_m=indenter.radius_m - fillet_m,
        end_m=indenter.radius_m,
        size_m=size_m,
        growth=growth,
        sector_count=sector_count,
    )
    options = ContactOptions(distance_m=BARRIER_M, bonded=bonded)
    model = pad_model(mesh, law_name=law_name, contact_options=options)
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
            f"force_end_{name}_n": forces[-1],
            f"force_rise_min_{name}_n": rise,
            f"min_jacobian_{name}": min(ratios),
            f"newton_iterations_{name}": path.counts.newton_iterations,
        },
    )
