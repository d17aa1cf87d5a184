"""Quarter and half models: which part of a pad is meshed, and what the whole carries."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from tacauchy_rig.core.arrays import FloatArray, IntArray

_SAME_POINT = 1e-9
# The nodes of faces and tetrahedra, linear and quadratic, in the order of their mirror image.
_FLIPPED = {
    3: (0, 2, 1),
    6: (0, 2, 1, 5, 4, 3),
    4: (0, 2, 1, 3),
    10: (0, 2, 1, 3, 6, 5, 4, 7, 9, 8),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class MirrorSymmetry:
    """Which coordinate planes mirror the modelled part."""

    mirror_x: bool = False  # the part lies at x >= 0 and the plane x = 0 mirrors it
    mirror_y: bool = False  # the part lies at y >= 0 and the plane y = 0 mirrors it

    @property
    def copies(self) -> int:
        """How many of the part make the whole."""
        return (2 if self.mirror_x else 1) * (2 if self.mirror_y else 1)

    def on_plane(self, points: FloatArray, size_m: float) -> NDArray[np.bool_]:
        """Return which coordinates a mirror plane holds still, shape [point_count, 3]."""
        mirrored = np.array([self.mirror_x, self.mirror_y, False])
        return mirrored & (np.abs(points) <= _SAME_POINT * size_m)

    def whole_force(self, force: FloatArray) -> FloatArray:
        """Return the force on the whole from that on the part, shape [3]."""
        return np.asarray(np.sum([sign * force for sign in self.signs()], axis=0))

    def whole_moment(self, moment: FloatArray) -> FloatArray:
        """Return the moment on the whole from that on the part, shape [3]; it is a pseudovector."""
        return np.asarray(np.sum([sign.prod() * sign * moment for sign in self.signs()], axis=0))

    def signs(self) -> Iterator[FloatArray]:
        """Yield the coordinate signs of each copy, the part itself first, shape [3]."""
        both = (1.0, -1.0)
        for y, x in product(both[: 1 + self.mirror_y], both[: 1 + self.mirror_x]):
            yield np.array([x, y, 1.0])


class WholeSurface:
    """The node numbering of the whole surface.

    Args:
        rest: Nodes of the part at rest [m], shape [node_count, 3].

    Attributes:
        sources: Node of the part that each node of the whole is, or mirrors.
        signs: Of its coordinates, shape [whole node_count, 3].
        numbers: Node of the whole that each node of the part is, shape [node_count].
    """

    def __init__(self, symmetry: MirrorSymmetry, rest: FloatArray) -> None:
        self._signs = list(symmetry.signs())
        copies = np.concatenate([rest * sign for sign in self._signs])
        grid = np.round(copies / (_SAME_POINT * max(float(np.abs(rest).max()), 1e-30)))
        _, first, inverse = np.unique(grid + 0.0, axis=0, return_index=True, return_inverse=True)
        copy, self.sources = np.divmod(first, len(rest))
        self.signs = np.array(self._signs)[copy]
        # Node of the whole that each node of every copy is.
        self._numbers = inverse.reshape(len(self._signs), len(rest)).astype(np.int32)
        self.numbers = self._numbers[0]

    def at_nodes(self, values: FloatArray) -> FloatArray:
        """Return numbers, vectors or tensors at the nodes of the whole from those of the part."""
        return _mirrored(values[self.sources], self.signs)

    def at_faces(self, values: FloatArray) -> FloatArray:
        """Return the same of faces or tetrahedra."""
        return np.concatenate([_mirrored(values, sign) for sign in self._signs])

    def nodal_forces(self, values: FloatArray) -> FloatArray:
        """Return nodal forces of the whole: on a mirror plane both sides add."""
        whole = np.zeros((len(self.sources), 3))
        np.add.at(whole, self._numbers, [values * sign for sign in self._signs])
        return whole

    def copies(self, faces: IntArray) -> IntArray:
        """Return the faces of the whole, their nodes in the order of the part's, copy by copy."""
        return np.concatenate([numbers[faces] for numbers in self._numbers])

    def faces(self, faces: IntArray) -> IntArray:
        """Return the faces or tetrahedra of the whole, none of them inside out."""
        flipped = list(_FLIPPED[faces.shape[1]])
        parts = [
            numbers[faces if sign.prod() > 0.0 else faces[:, flipped]]
            for numbers, sign in zip(self._numbers, self._signs, strict=True)
        ]
        return np.concatenate(parts)


def _mirrored(values: FloatArray, signs: FloatArray) -> FloatArray:
    """Return images of numbers [n], vectors [n, 3] or tensors [n, 3, 3]; signs [n, 3] or [3]."""
    if values.ndim == 1:
        return values
    if values.ndim == 2:
        return values * signs
    return values * signs[..., None] * signs[..., None, :]
