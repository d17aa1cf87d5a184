"""Many tactile images at once, on a GPU or a CPU, by the same formula as ``TactileRenderer``."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from sim.optics.camera_geometry import CameraGeometry, ImageArray
from sim.optics.render.gaussian import gaussian_weights
from sim.optics.render.nominal import Lamp
from sim.optics.render.photometric.model import PhotometricModel
from sim.optics.render.photometric.polynomial import polynomial_plan
from sim.optics.render.photometric.shading_terms import CREASE_UNIT_M
from sim.optics.render.render import TactileRenderer
from sim.optics.render.render_kernel import (
    MOST_POWERS,
    SurfaceTerm,
    blur_across,
    colour_pixels,
    darken_pixels,
    expose_pixels,
    scale_pixels,
    shade_pixels,
    sweep_rays,
)
from sim.optics.render.shadows.horizon import Sweep, sweep_places, sweep_towards
from sim.optics.render.shadows.shadow import ShadowCaster, rise_in_a_step_m
from tacauchy_rig.errors import ConfigError


@dataclass(frozen=True, slots=True)
class _LampOnDevice:
    """A lamp's sweep, and what its two kernels take of it."""

    sweep: Sweep
    rays: list[Any]
    light: list[Any]


class BatchRenderer:
    """Renders stacks of indentation maps over one no-contact frame.

    Args:
        background: No-contact frame, RGB, shape [height, width, 3].
        rest_height: Height map of the unloaded gel [m], of ``geometry.refined(samples)``.
        model: Colour of a surface.
        geometry: Pixels.
        shadows: Lamps that the dent hides; None where the sensor shows no shadows.
        samples: Into how many samples each pixel is divided both ways.
        blur_px: Standard deviation of the camera's blur [px].
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
        shadows: ShadowCaster | None = None,
        samples: int = 1,
        blur_px: float = 0.0,
        device: str | None = None,
    ) -> None:
        if int(model.exponents.max(initial=0)) >= MOST_POWERS:
            raise ConfigError(
                f"a model of degree {model.exponents.max()} is too high for batches",
                remedy=f"fit one of degree {MOST_POWERS - 1} at most",
            )
        single = TactileRenderer(
            background,
            rest_height,
            model,
            geometry,
            shadows=shadows,
            samples=samples,
            blur_px=blur_px,
        )
        fine = geometry.refined(samples)
        self._device = device
        self._pixels = (geometry.height, geometry.width)
        relative = self._array((rest_height - rest_height.flat[0]).astype(np.float32), wp.float32)
        self._surface: list[Any] = [
            wp.vec2f(fine.scale_x_m, fine.scale_y_m),
            samples,
            relative,
        ]
        self._colours = [*self._polynomial(model), *self._surface]
        self._shading = None if model.terms is None else [*self._terms(model), *self._surface]
        weights = self._array(gaussian_weights(blur_px), wp.float32)
        base = single.base.transpose(1, 2, 0)
        self._across = [weights]
        self._exposure = [
            weights,
            self._array(base.astype(np.float32), wp.vec3f),
            float(model.response.knee),
        ]
        self._gain: list[Any] | None = None
        if single.gain is not None:
            gain = single.gain.transpose(1, 2, 0)
            self._gain = [self._array(gain.astype(np.float32), wp.vec3f)]
        self._lamps: list[_LampOnDevice] = []
        if shadows is not None:
            self._lamps = [self._lamp(lamp, shadows.softness_m, fine) for lamp in shadows.lamps]

    def render(self, indentation_m: Any) -> Any:
        """Return the images as a Warp array of uint8, shape [batch, height, width, 3].

        Args:
            indentation_m: Unloaded minus loaded height [m], a Warp float32 array on the renderer's
                device or a NumPy array, shape [batch, height, width], of the samples.
        """
        dent = indentation_m
        if isinstance(dent, np.ndarray):
            dent = self._array(dent.astype(np.float32), wp.float32)
        shape = (dent.shape[0], *self._pixels)
        change, blurred = (wp.empty(shape, dtype=wp.vec3f, device=self._device) for _ in range(2))
        images = wp.empty((*shape, 3), dtype=wp.uint8, device=self._device)
        self._launch(colour_pixels, shape, [*self._colours, dent], change)
        if self._shading is not None:
            self._launch(shade_pixels, shape, [*self._shading, dent], change)
        if self._gain is not None:
            self._launch(scale_pixels, shape, self._gain, change)
        for lamp in self._lamps:
            rays = (shape[0], lamp.sweep.step_count, lamp.sweep.ray_count)
            highest = wp.empty(rays, dtype=wp.float32, device=self._device)
            self._launch(sweep_rays, rays[::2], [*lamp.rays, dent], highest)
            inputs = [*lamp.rays, *lamp.light, *self._surface, dent, highest]
            self._launch(darken_pixels, shape, inputs, change)
        self._launch(blur_across, shape, [*self._across, change], blurred)
        self._launch(expose_pixels, shape, [*self._exposure, blurred], images)
        return images

    def _polynomial(self, model: PhotometricModel) -> list[Any]:
        plan = polynomial_plan(model.exponents, model.coefficients, np.dtype(np.float32))
        places, surfaces = len(plan.places), len(plan.surface)
        weights = plan.weights.reshape(places, 3, surfaces).transpose(0, 2, 1)
        return [
            self._array(plan.surface[:, [0, 1, 4]].astype(np.int32), SurfaceTerm),
            self._array(np.array(plan.places, dtype=np.int32), wp.vec2i),
            self._array(weights.astype(np.float32), wp.vec3f),
            float(model.tilt_limit),
            float(min(model.indentation_limit_m, 1e3)),
        ]

    def _terms(self, model: PhotometricModel) -> list[Any]:
        terms = model.terms
        if terms is None:
            return []
        lamps = [
            (
                lamp.distance * math.cos(lamp.azimuth_rad),
                lamp.distance * math.sin(lamp.azimuth_rad),
                lamp.distance * math.tan(lamp.elevation_rad),
            )
            for lamp in terms.lamps
        ]
        weights = model.term_coefficients.reshape(len(lamps) + 1, -1, 3)
        return [
            self._array(np.array(lamps, dtype=np.float32).reshape(-1, 3), wp.vec3f),
            float(terms.softness),
            float(terms.aspect),
            float(terms.crease_limit),
            CREASE_UNIT_M,
            self._array(weights.astype(np.float32), wp.vec3f),
        ]

    def _lamp(self, lamp: Lamp, softness_m: float, fine: CameraGeometry) -> _LampOnDevice:
        sweep = sweep_towards(lamp.azimuth_rad, (fine.height, fine.width))
        places = sweep_places(sweep, rise_in_a_step_m(lamp, sweep, fine))
        level = math.cos(lamp.elevation_rad)
        towards = (
            level * math.cos(lamp.azimuth_rad),
            level * math.sin(lamp.azimuth_rad),
            math.sin(lamp.elevation_rad),
        )
        return _LampOnDevice(
            sweep,
            [
                int(sweep.along_columns),
                int(sweep.forward),
                self._array(places.whole.astype(np.int32), wp.int32),
                self._array(places.part, wp.float32),
                self._array(places.sunk_m, wp.float32),
            ],
            [wp.vec3f(*towards), wp.vec3f(*lamp.colour), float(softness_m)],
        )

    def _array(self, values: NDArray[Any], dtype: Any) -> Any:
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=self._device)

    def _launch(self, kernel: Any, shape: tuple[int, ...], inputs: list[Any], output: Any) -> None:
        wp.launch(kernel, dim=shape, inputs=inputs, outputs=[output], device=self._device)
