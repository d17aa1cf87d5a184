"""What every model of colours comes to: changes of light over the pixels of one camera."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from sim.optics.colour.response import LINEAR, Response
from sim.optics.pixels.pixel_blocks import PixelBlocks
from tacauchy_rig.core.arrays import Float32Array, RealArray

SampleColours = Callable[[Float32Array, Float32Array], RealArray]
"""From the samples' tilt along columns and rows, dz/dx / sqrt(1 + |grad z|^2), shape
[2, rows, columns], and indentation [m], shape [rows, columns], to the change of light of red,
green and blue [grey levels], shape [3, rows, columns]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelColours:
    """What is drawn of a model over a no-contact frame: a Warp kernel, or a NumPy function.

    Attributes:
        light: Of the no-contact frame [grey levels], shape [3, height, width].
        kernel: From the samples' tilts and indentations to the mean change of light of pixels.
        inputs: Of the kernel, but for samples.
        function: In place of a kernel.
    """

    light: Float32Array
    response: Response = LINEAR
    kernel: Any = None
    inputs: Sequence[Any] = ()
    function: SampleColours | None = None


class ColourModel(Protocol):
    """Colours of a surface, whatever draws them."""

    @property
    def provenance(self) -> Mapping[str, object]:
        """Where the model comes from, as JSON values with units in the keys."""

    def over(self, frame: Float32Array, layout: PixelBlocks) -> PixelColours:
        """Make it ready for a no-contact frame [grey levels], shape [3, height, width]."""
