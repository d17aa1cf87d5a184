"""Many tactile images at once, on a GPU or a CPU, by the same formula as ``TactileRenderer``."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from sim.optics.geometry import CameraGeometry, ImageArray
from sim.optics.photometric import PhotometricModel
from sim.optics.render import TactileRenderer
from sim.optics.render_kernel import MOST_POWERS, Term, render_images
from tacauchy_rig.errors import ConfigError


class BatchRenderer:
    """Renders stacks of indentation maps over one no-contact frame.

    Args:
        background: No-contact frame, RGB, shape [height, width, 3].
        rest_height: Height map of the unloaded gel [m], shape [height, width].
        model: Colour of a surface.
        geometry: Pixels.
        device: Warp's name of the device, such as ``cuda:0``; None takes its default.

    Raises:
        ConfigError: A shape is wrong, or the model's degree is above 7.
    """

    def __init__(
        self,
        background: ImageArray,
        rest_height: NDArray[np.floating],
        model: PhotometricModel,
        geometry: CameraGeometry,
        *,
        device: str | None = None,
    ) -> None:
        if int(model.exponents.max(initial=0)) >= MOST_POWERS:
            raise ConfigError(
                f"a model of degree {model.exponents.max()} is too high for batches",
                remedy=f"fit one of degree {MOST_POWERS - 1} at most",
            )
        single = TactileRenderer(background, rest_height, model, geometry)
        relative = rest_height - rest_height.flat[0]
        base = single.base.T.reshape(*rest_height.shape, 3)
        self._device = device
        self._shape = rest_height.shape
        self._inputs: list[Any] = [
            self._array(model.exponents.astype(np.int32), Term),
            self._array(model.coefficients.astype(np.float32), wp.vec3f),
            float(model.tilt_limit),
            float(min(model.indentation_limit_m, 1e3)),
            wp.vec2f(geometry.scale_x_m, geometry.scale_y_m),
            self._array(relative.astype(np.float32), wp.float32),
            self._array(np.ascontiguousarray(base, dtype=np.float32), wp.vec3f),
        ]

    def render(self, indentation_m: Any) -> Any:
        """Return the images as a Warp array of uint8, shape [batch, height, width, 3].

        Args:
            indentation_m: Unloaded minus loaded height [m], a Warp float32 array on the renderer's
                device or a NumPy array, shape [batch, height, width].
        """
        if isinstance(indentation_m, np.ndarray):
            indentation_m = self._array(indentation_m.astype(np.float32), wp.float32)
        images = wp.empty((*indentation_m.shape, 3), dtype=wp.uint8, device=self._device)
        wp.launch(
            render_images,
            dim=indentation_m.shape,
            inputs=[*self._inputs, indentation_m],
            outputs=[images],
            device=self._device,
        )
        return images

    def _array(self, values: NDArray[Any], dtype: Any) -> Any:
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=self._device)
