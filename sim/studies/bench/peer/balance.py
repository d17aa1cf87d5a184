"""What libuipc's presses are worth: forces from its positions, and whether they balance.

The gel's law is the same in both engines, so its forces follow from the positions alone. At the
clamped base they are the reaction; at every other node they and those of contact should vanish
together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.arrays import FloatArray
from sim.studies.bench.peer.peer_pad import PeerPad
from sim.studies.bench.peer.task import PeerFound, PeerTask


@dataclass(frozen=True, slots=True, kw_only=True)
class PeerBalance:
    """Forces of the last frame.

    Attributes:
        force_n: F_z of the first environment: reaction of the base [N].
        imbalance: Base reaction against libuipc's contact force, over the latter, the largest; not
            a number where libuipc does not say its contact force.
        residual: Norm of the unbalanced force over the contact force, the largest; likewise.
        inner_residual: The same over the nodes that contact does not push: it tells what the
            engines' laws and iterations differ by from what contact makes of it.
        gap_m: The smallest height of the indenter's underside above a node of the gel [m].
        depth_error_m: By how much the indenter went too deep, the largest of either sign [m].
    """

    force_n: float
    imbalance: float
    residual: float
    inner_residual: float
    gap_m: float
    depth_error_m: float


def peer_balance(pad: PeerPad, task: PeerTask, found: PeerFound) -> PeerBalance:
    """Judge the last frame of every environment.

    Args:
        task: Of the pad; its first environment has the pad's own gel.
    """
    model = pad.model
    forces, imbalances, residuals, inner_residuals, gaps = [], [], [], [], []
    for number, positions in enumerate(found.positions):
        stiffer = task.young_pa[number] / task.young_pa[0]
        elastic = stiffer * model.elastic_gradient(positions)
        base_n = float(elastic[task.clamped, 2].sum())
        forces.append(base_n)
        gaps.append(_gap(pad, positions, float(found.tips_m[number])))
        if found.contact_n is not None:
            contact = found.contact_n[number]
            pushed_n = max(float(np.linalg.norm(contact.sum(axis=0))), 1e-300)
            imbalances.append(abs(base_n + float(contact[:, 2].sum())) / pushed_n)
            unbalanced = (elastic - contact)[~task.clamped]
            residuals.append(float(np.linalg.norm(unbalanced)) / pushed_n)
            inside = ~contact[~task.clamped].any(axis=1)
            inner_residuals.append(float(np.linalg.norm(unbalanced[inside])) / pushed_n)
    wrong_m = task.touch_m - task.depths_m[-1] - found.tips_m
    return PeerBalance(
        force_n=forces[0],
        imbalance=max(imbalances, default=float("nan")),
        residual=max(residuals, default=float("nan")),
        inner_residual=max(inner_residuals, default=float("nan")),
        gap_m=min(gaps),
        depth_error_m=float(wrong_m[np.argmax(np.abs(wrong_m))]),
    )


def _gap(pad: PeerPad, positions: FloatArray, tip_m: float) -> float:
    surface = positions[np.unique(pad.model.faces)]
    above = tip_m + pad.cylinder.lower_surface(surface[:, 0], surface[:, 1]) - surface[:, 2]
    return float(above.min())
