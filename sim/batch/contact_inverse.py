"""The inverse that serves any contact: the undeformed gel's, corrected for the touching nodes."""

from functools import partial
from typing import Any

import numpy as np
import warp as wp

from sim.batch import contact_inverse_kernels as kernels
from sim.batch.rest_inverse import DenseRest, FactoredRest
from sim.device import Device, filled
from sim.solve.descents import Descents
from sim.solve.model import Model
from tacauchy_rig.core.arrays import FloatArray, IntArray

# Stiffness that holds the height of a pushed indenter, over E H with the pad's height H: contact is
# 0.1 to 2 times that, so that the inverse is off by a few per cent along one direction only.
_HELD_SHARE = 0.01
# Threads of a block that has an environment, on a GPU.
_THREADS = 512
# Nodes that stand for all.
_ASKED = 64


class ContactInverse:
    """``Inverse`` of the stiffness of every environment where it is now.

    Args:
        count: Environments.
        young_share: E of the model over theirs, shape [count].
    """

    def __init__(self, model: Model, *, count: int, young_share: FloatArray) -> None:
        self._model, self._count = model, count
        self._device = device = Device(model.device)
        surface = np.unique(model.faces)
        # Along the pad, so that few of the touching nodes are coupled with one of them.
        surface = surface[np.lexsort(model.nodes[surface].T[::-1])]
        unknowns = np.full(3 * len(model.nodes), -1, dtype=np.int32)
        unknowns[model.pattern.free_dofs] = np.arange(model.pattern.dof_count)
        rows = unknowns.reshape(-1, 3)[surface]
        surface, rows = surface[(rows >= 0).any(axis=1)], rows[(rows >= 0).any(axis=1)]
        self._rest: Any = (DenseRest if device.is_gpu else FactoredRest)(model, rows, count=count)
        self.kind, self.scaled, self.unit = self._rest.kind, self._rest.scaled, self._rest.unit
        self.weights = self._rest.weights
        self.row_count, self.column_count = self._rest.row_count, self._rest.column_count
        numbers = np.full(len(model.nodes), -1, dtype=np.int32)
        numbers[surface] = np.arange(len(surface))
        faces = numbers[model.faces]
        capacity = min(kernels.CAPACITY, len(surface))
        self._correction = filled(
            kernels.Correction,
            rows=device.array(rows, wp.int32),
            faces=device.array(faces, wp.int32),
            around=device.array(_around(faces, len(surface)), wp.int32),
            values=device.array(model.reference.face_values, wp.float32),
            compliance=self._rest.compliance,
            held=_HELD_SHARE * model.young_pa * model.height_m,
            shares=device.array(young_share, wp.float64),
            renews=device.zeros(count, wp.int32),
            stiffness=device.zeros((count, *model.surface.areas.shape), wp.mat33f),
            touching=device.zeros((count, len(surface)), wp.int32),
            local=device.zeros((count, len(surface)), wp.int32),
            counts=device.zeros(count, wp.int32),
            listed=device.zeros((count, capacity), wp.int32),
            along=device.zeros((count, 3 * capacity * kernels.WIDE), wp.float32),
            inverse=device.zeros((count, 3 * capacity, 3 * capacity), wp.float32),
        )
        self._units = device.array(self.unit * young_share, wp.float64)
        self._tips = device.zeros(count, wp.float64)
        self._launches: Any = None

    def middle_compliance(self) -> float:
        """Return the median compliance along z of nodes amid the surface's edges [m/N]."""
        middles = np.setdiff1d(self._correction.faces.numpy()[:, 3:], [-1])
        asked = middles[np.linspace(0, len(middles) - 1, _ASKED).astype(np.intp)]
        self._rest.need(asked)
        across = len(self._rest.compliance) + 1
        along_z = self._rest.compliance.reshape(-1)[2 * across :: 3 * across].contiguous().numpy()
        return float(np.median(along_z[asked]))

    def serve(self, descents: Descents) -> None:
        """Learn whose contact to look at."""
        device, model, c = self._device, self._model, self._correction
        correct, set_tip = kernels.correct_kernels(self.kind)
        tip_row, state = model.pattern.dof_count, descents.state
        self._places = [self._rest.places(state).launch] if device.is_gpu else []
        self._corrected = device.zeros(descents.sources.shape, self.kind)

        def blocks(kernel: Any, inputs: list[Any]) -> Any:
            threads = _THREADS if device.is_gpu else 1
            return device.record(kernel, (self._count, threads), inputs, threads)

        gaps = descents.memory.gaps
        at = [descents.pressed, c.faces, c.renews, gaps, c.stiffness, c.touching]
        made, points = model.surface.batch_kernels, tuple(descents.contact_buffers[1].shape)
        given = [descents.sources, descents.found, self._corrected, self._tips]
        self._launches = (
            device.record(kernels.choose, tuple(c.touching.shape), [state, c]),
            device.record(made.stiffen, points, at),
            blocks(kernels.list_touching, [c]),
            blocks(kernels.factor, [state, c]),
            blocks(correct, [state, c, tip_row, self._units, self.weights, *given]),
            device.record(set_tip, (self._count,), [state, tip_row, self._tips, descents.found]),
        )

    def apply(self, asked: Any, sources: Any, found: Any, prepare: Any = lambda: None) -> None:
        """Set ``found`` to the inverse times ``sources``, shape [column_count, row_count]."""
        chosen, stiffen, listing, factored, correct, set_tip = self._launches
        rest = partial(self._rest.apply, asked, sources, found, at_surface=True)
        with self._device.beside(*self._places, prepare, rest):
            for each in (chosen, stiffen, listing):
                each.launch()
            if asked is not None:
                counts, listed = self._correction.counts.numpy(), self._correction.listed.numpy()
                self._rest.need(np.concatenate([listed[b, : counts[b]] for b in asked]))
            factored.launch()
        correct.launch()
        self._rest.apply(asked, self._corrected, found)
        set_tip.launch()


def _around(faces: IntArray, count: int) -> IntArray:
    """Return the corners of faces at each of so many nodes, -1 after the last."""
    flat = faces.reshape(-1)
    corners = np.argsort(flat, kind="stable")
    corners = corners[flat[corners] >= 0]
    nodes = flat[corners]
    place = np.arange(len(nodes)) - np.searchsorted(nodes, nodes)
    found = np.full((count, int(place.max()) + 1), -1, dtype=np.int32)
    found[nodes, place] = corners
    return found
