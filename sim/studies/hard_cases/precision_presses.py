"""Presses of which the precision of the kernels is asked; as a program it prints them as JSON."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass

from sim.contact.state import ContactOptions
from sim.device import KERNEL_EPSILON
from sim.mesh.elements import ElementOrder
from sim.scene.indenter import Indenter, describe
from sim.solve.load_steps.path import LoadingPath
from sim.studies.hard_cases.pads import BALL, PUNCH, pad_model, round_mesh

BARRIERS_M = (1e-5, 1e-6)
_DEPTH_M = 0.3e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Pressed:
    """One press.

    Attributes:
        barrier_m: d_hat [m].
        force_n: F_z [N].
        residual_n: Norm of what is unbalanced at the end [N].
        stalled: Newton said that rounding ended it.
        kernel_epsilon: Relative rounding of the kernels that computed it.
    """

    name: str
    barrier_m: float
    force_n: float
    residual_n: float
    stalled: bool
    iterations: int
    kernel_epsilon: float


def presses() -> list[Pressed]:
    """Press a punch and a ball into linear and quadratic elements."""
    return [
        _press(order, indenter, barrier_m)
        for barrier_m in BARRIERS_M
        for order in ElementOrder
        for indenter in (PUNCH, BALL)
    ]


def _press(order: ElementOrder, indenter: Indenter, barrier_m: float) -> Pressed:
    options = ContactOptions(distance_m=barrier_m)
    path = LoadingPath(pad_model(round_mesh(), order=order, contact_options=options), indenter)
    point = path.advance(_DEPTH_M)
    return Pressed(
        name=f"{order.value} {describe(indenter)}",
        barrier_m=barrier_m,
        force_n=float(point.force_n[2]),
        residual_n=point.equilibrium.residual_n,
        stalled=point.equilibrium.stalled,
        iterations=path.counts.newton_iterations,
        kernel_epsilon=KERNEL_EPSILON,
    )


if __name__ == "__main__":
    sys.stdout.write(json.dumps([asdict(press) for press in presses()]))
