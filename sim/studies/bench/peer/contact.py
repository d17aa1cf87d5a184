"""The force of contact on the gel's nodes, as libuipc says it."""

from __future__ import annotations

import importlib

import numpy as np

from sim.arrays import FloatArray
from sim.studies.bench.peer.tolerance import FRAME_S
from sim.studies.bench.peer.world import PeerWorld

# Of the kinds of pairs that libuipc knows, those of normal contact.
_NORMAL = "+N"


def contact_forces(world: PeerWorld) -> FloatArray | None:
    """Return the force on every node [N], shape [count, node_count, 3]; None if there is no way.

    libuipc keeps the gradient of its last assembly, that of energy times the square of a frame's
    time, at the positions from which the last Newton step started. After a frame in which nothing
    moves, with one step only, these are the positions that the frame before it ended with.
    """
    core, geometry = (importlib.import_module(f"uipc.{name}") for name in ("core", "geometry"))
    feature = world.world.features().find(core.ContactSystemFeature)
    if feature is None:
        return None
    count, node_count = world.task.count, len(world.task.nodes)
    found = np.zeros((count * node_count, 3))
    first = _first_vertex(world)
    for kind in feature.contact_primitive_types():
        if not kind.endswith(_NORMAL):
            continue
        pairs = geometry.Geometry()
        feature.contact_gradient(kind, pairs)
        vertices, gradients = (pairs.instances().find(name) for name in ("i", "grad"))
        if vertices is None or gradients is None:
            continue
        at = np.array(vertices.view()).reshape(-1) - first
        on_gel = (at >= 0) & (at < len(found))
        forces = -np.array(gradients.view()).reshape(-1, 3) / FRAME_S**2
        np.add.at(found, at[on_gel], forces[on_gel])
    return found.reshape(count, node_count, 3)


def _first_vertex(world: PeerWorld) -> int:
    """Return the number that libuipc gives the gel's first vertex among all."""
    offset = world.gel.meta().find(world.uipc.builtin.global_vertex_offset)
    return 0 if offset is None else int(np.array(offset.view()).reshape(-1)[0])
