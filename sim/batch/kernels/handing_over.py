"""Warp function by which a chunk's elements hand their nodal forces over in shared memory."""

# Device code: Warp compiles it, and Python type checkers do not speak its dialect.
# mypy: ignore-errors

from __future__ import annotations

from typing import Any

import warp as wp

from sim.batch.kernels.element_forces import BatchGel, Tangents
from sim.batch.layout import Layout
from sim.batch.numbering import Gathering
from sim.mesh.elements import ReferenceElement
from sim.warp_start import start_warp

start_warp()


def room_for(reference: ReferenceElement, layout: Layout) -> int:
    """Return the places that a chunk takes: one for every nodal component, and one for a zero."""
    return 3 * reference.node_count * layout.chunk + 1


def hand_over_function(of_element: Any, reference: ReferenceElement, layout: Layout) -> Any:
    """Build the function.

    Args:
        of_element: Gives an element's nodal forces, or their change, at displacements or along
            directions in shared memory.
    """
    node_count, chunk = reference.node_count, layout.chunk

    @wp.func
    def hand_over(
        c: wp.int32,
        b: wp.int32,
        thread: wp.int32,
        gel: BatchGel,
        at: Any,
        tangents: Tangents,
        gathering: Gathering,
        contributions: Any,
    ):
        last = gathering.element_count - 1
        for i in range(thread, wp.static(chunk), wp.block_dim()):
            e = c * wp.static(chunk) + i
            total = of_element(wp.min(e, last), b, gel, at, tangents)
            for k in range(wp.static(node_count)):
                for axis in range(3):
                    place = (3 * k + axis) * wp.static(chunk) + i
                    wp.tile_scatter_masked(contributions, place, total[k, axis], e <= last)

    return hand_over
