"""What friction takes out of a slide there and back, point by point and as a whole."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.contact.state import ContactOptions, Grip
from sim.mesh.elements import ElementOrder
from sim.press import contact_measures
from sim.solve.load_steps.path import Hold, LoadingPath
from sim.solve.load_steps.path_point import PathPoint
from sim.solve.model import Model
from sim.studies.hard_cases.pads import BALL, BARRIER_M, pad_model, round_mesh

_DEPTH_M = 0.3e-3
_LEG_M = 0.05e-3
_LEGS = (1.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0, -1.0)
# A slip is a difference of places some hundred times as large, so that its last places are noise.
_DISSIPATION_ROUNDING = 256.0 * float(np.finfo(np.float64).eps)


@dataclass(frozen=True, slots=True, kw_only=True)
class Slide:
    """A slide there and back.

    Attributes:
        point_min_j: Least dissipation of a contact point in an increment [J].
        dissipated_j: Sum over points and increments: friction's force times slip [J].
        work_less_stored_j: The indenter's work by the trapezoidal rule less what is stored [J].
    """

    equilibria: int
    balance_relative: float
    gap_min_m: float
    point_min_j: float
    dissipated_j: float
    work_less_stored_j: float

    @property
    def gives_nothing_back(self) -> bool:
        """Whether every point dissipates at every increment, to rounding."""
        return self.point_min_j >= -_DISSIPATION_ROUNDING * self.dissipated_j


def slide_and_return() -> Slide:
    """Press a ball in, slide it by 0.2 mm and back at the same depth."""
    options = ContactOptions(distance_m=BARRIER_M, friction=0.4)
    mesh = round_mesh(symmetric=False)
    model = pad_model(mesh, order=ElementOrder.P1, contact_options=options)
    path = LoadingPath(model, BALL, step_max_m=_LEG_M)
    point = path.advance(_DEPTH_M)
    stored = _stored(path, point)
    balances, gaps, lost = [], [], []
    work = 0.0
    for sign in _LEGS:
        before = point
        point = path.carry(shift_m=(sign * _LEG_M, 0.0), hold=Hold.DEPTH)
        travel = point.state.tip - before.state.tip
        work -= 0.5 * float((before.force_n + point.force_n) @ travel)
        lost.append(_dissipation(before, point))
        balances.append(balance_relative(model, point))
        gaps.append(contact_measures(path, point).gap_min_m)
    return Slide(
        equilibria=len(_LEGS),
        balance_relative=max(balances),
        gap_min_m=min(gaps),
        point_min_j=min(least for least, _ in lost),
        dissipated_j=sum(total for _, total in lost),
        work_less_stored_j=work - (_stored(path, point) - stored),
    )


def balance_relative(model: Model, point: PathPoint) -> float:
    """Return |indenter's force less base reaction| over the force."""
    clamp = point.equilibrium.elastic_gradient[model.clamped].sum(axis=0)
    away = point.force_n - model.mesh.symmetry.whole_force(clamp)
    return float(np.linalg.norm(away) / np.linalg.norm(point.force_n))


def _dissipation(before: PathPoint, after: PathPoint) -> tuple[float, float]:
    """Return the least and the summed tangential force times slip of points that held on [J]."""
    earlier, later = _grip(before), _grip(after)
    both = (earlier.held == 1) & (later.held == 1)
    loads = later.loads[both]
    normals = loads / np.linalg.norm(loads, axis=1, keepdims=True)
    forces = after.equilibrium.contact.forces[both] @ after.state.rotation
    tangential = forces - np.sum(forces * normals, axis=1, keepdims=True) * normals
    lost = np.sum(tangential * (later.anchors[both] - earlier.anchors[both]), axis=1)
    return float(lost.min()), float(lost.sum())


def _grip(point: PathPoint) -> Grip:
    if point.state.grip is None:
        raise ValueError("a slide without friction has no grip")
    return point.state.grip


def _stored(path: LoadingPath, point: PathPoint) -> float:
    """Return elastic, barrier and friction's recoverable energy [J]."""
    positions = point.state.positions
    elastic, _ = path.model.elastic_energy(positions)
    return elastic + path.model.contact_energy(positions, path.indenter, point.state)
