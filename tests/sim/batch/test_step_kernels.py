"""How environments share the pilot's inverses."""

from __future__ import annotations

import numpy as np
import warp as wp

from sim.batch import step_kernels as kernels
from sim.device import Device

_CPU = Device("cpu")


@wp.kernel(enable_backward=False)
def _share_out(sharing: kernels.InverseSharing):
    kernels.share_out(sharing, wp.tid())


def test_every_inverse_has_columns_of_its_own() -> None:
    """Blocks of 8: three environments take one, none takes none, and nine take two."""
    sharing = _CPU.zeroed(
        kernels.InverseSharing,
        (12,),
        counts=(3,),
        first=(3,),
        blocks=(5,),
    )
    sharing.width = 8
    sharing.counts.assign(np.array([3, 0, 9], dtype=np.int32))
    wp.launch(_share_out, 3, inputs=[sharing], device="cpu")
    assert sharing.blocks.numpy().tolist() == [0, 2, 2, -1, -1]
    assert sharing.first.numpy()[[0, 2]].tolist() == [0, 8]
