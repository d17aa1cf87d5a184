"""Grey level by depth: the optics of a sensor that sees a translucent gel grow thinner (9DTact).

Before a calibration the sensor's file gives a table; ball presses give a polynomial in the
indentation alone, with ``GREY_EXPONENTS`` in place of the terms of slope and place.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from sim.optics.colour.polynomial import polynomial_exponents

GREY_EXPONENTS = polynomial_exponents(
    tilt_degree=0, position_degree=0, indentation_degree=4, indentation_tilt_degree=0
)


@dataclass(frozen=True, slots=True)
class GreyDepthModel:
    """Change of the grey level as a table of indentation, the same for all channels.

    The table has the camera's response in it, and holds over any no-contact frame.

    Attributes:
        depth_m: Rising indentations from 0 [m].
        change: Grey levels added at each; beyond the last the change stays.
        provenance: Where the table comes from.
    """

    depth_m: Sequence[float]
    change: Sequence[float]
    provenance: Mapping[str, object] = field(
        default_factory=lambda: {"source": "nominal table of the sensor's file"}
    )
