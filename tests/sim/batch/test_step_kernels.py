"""How environments share the pilot's inverses."""

from __future__ import annotations

import numpy as np
import warp as wp

from sim.batch import step_kernels as kernels
from sim.device import Device

_CPU = Device("cpu")


@wp.kernel(enable_backward=False)
def _share_out(together: kernels.Together):
    kernels.share_out(together, wp.tid())


def test_every_inverse_has_columns_of_its_own() -> None:
    """Blocks of 8: three environments take one, none takes none, and nine take two."""
    together = _CPU.zeroed(
        kernels.Together,
        (12,),
        counts=(3,),
        first=(3,),
        blocks=(5,),
    )
    together.width = 8
    together.counts.assign(np.array([3, 0, 9], dtype=np.int32))
    wp.launch(_share_out, 3, inputs=[together], device="cpu")
    assert together.blocks.numpy().tolist() == [0, 2, 2, -1, -1]
    assert together.first.numpy()[[0, 2]].tolist() == [0, 8]
