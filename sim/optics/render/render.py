"""From height maps to the tactile image of a colour-lit sensor."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sim.optics.camera_geometry import CameraGeometry, ImageArray
from sim.optics.height.tilt import Float32Array
from sim.optics.render.gaussian import blurred, gaussian_weights
from sim.optics.render.photometric.model import normalised_positions
from sim.optics.render.photometric.polynomial import RealArray
from sim.optics.render.pixel_exposure import ExposedRows
from sim.optics.render.pixel_kernel import LANES
from sim.optics.render.pixel_planes import PixelLayout, Planes, SampleBuffers, SampledBand
from sim.optics.render.response import Response
from sim.optics.render.shadows.shadow import ShadowCaster
from sim.optics.render.shadows.shadow_planes import ShadowPlanes
from sim.optics.render.two_threads import Task, TwoThreads
from tacauchy_rig.errors import ConfigError

# So much of every array stays in the cache together.
_BAND_PIXELS = 6_400


class PixelColours(Protocol):
    """Mean change of colour of pixels' samples [grey levels]."""

    def over(self, band: SampledBand, change: Planes) -> Callable[[], None]:
        """Return what writes that of a band's samples, whenever they are new, to three planes."""
        ...


class ColourModel(Protocol):
    """Change of light that a surface brings, and the camera that sees it."""

    @property
    def response(self) -> Response:
        """How the camera shows light."""
        ...

    def gain(self, light: RealArray) -> RealArray | None:
        """Return what the change is multiplied by over a no-contact frame's light; None is 1."""
        ...

    def evaluate(
        self,
        tilt: RealArray,
        position: RealArray,
        indentation_m: RealArray,
        curvature: RealArray | None = None,
    ) -> RealArray:
        """Return red, green, blue [grey levels], [3, n], from [2, n], [2, n], [n] and [n]."""
        ...

    def of_pixels(self, position: RealArray, layout: PixelLayout) -> PixelColours:
        """Return it made ready for an image's pixels, their places row after row [2, n]."""
        ...


class TactileRenderer:
    """Renders height maps over one no-contact frame.

    image = no-contact frame + model(loaded gel) - model(unloaded gel), less the shadows that the
    dent casts: the unloaded gel gives back the no-contact frame exactly. One image at a time, on
    two threads.

    Args:
        background: No-contact frame, RGB, shape [height, width, 3].
        rest_height: Height map of the unloaded gel [m], shape [height, width].
        model: Colour of a tilt.
        geometry: Pixels.
        shadows: Lamps that the dent hides; None where the sensor shows no shadows.
        samples: Into how many samples each pixel is divided both ways: a pixel gathers the light
            of its whole area, which at a sharp rim no single point stands for. Height maps are
            then of ``geometry.refined(samples)``.
        blur_px: Standard deviation of the camera's blur [px].

    Raises:
        ConfigError: An image or map has not the geometry's size.
    """

    def __init__(
        self,
        background: ImageArray,
        rest_height: NDArray[np.floating],
        model: ColourModel,
        geometry: CameraGeometry,
        *,
        shadows: ShadowCaster | None = None,
        samples: int = 1,
        blur_px: float = 0.0,
    ) -> None:
        self._geometry, self._fine = geometry, geometry.refined(samples)
        _check_shape("no-contact frame", background.shape, (geometry.height, geometry.width, 3))
        _check_shape(
            "unloaded height map", rest_height.shape, (self._fine.height, self._fine.width)
        )
        self._rest_height = rest_height
        layout = PixelLayout(geometry=geometry, samples=samples)
        places = normalised_positions(geometry.height, geometry.width)
        self._colours = model.of_pixels(places, layout)
        self._change = Planes(3, geometry.height, layout.blocks)
        rows = min(max(1, _BAND_PIXELS // geometry.width), geometry.height)
        buffers = [SampleBuffers(layout, rows) for _ in range(2)]
        self._bands = [
            SampledBand(
                layout,
                slice(start, min(start + rows, geometry.height)),
                rest_height,
                buffers[number % 2],
            )
            for number, start in enumerate(range(0, geometry.height, rows))
        ]
        light = model.response.light(background.astype(np.float32)).transpose(2, 0, 1)
        self._gain = model.gain(light)
        self._shadows = None if shadows is None else ShadowPlanes(shadows, layout, rest_height)
        self._colour = [self._coloured(band) for band in self._bands]
        self._threads = TwoThreads()
        self._find_change(rest_height)
        weights = gaussian_weights(blur_px)
        change = blurred(self._pixels_of(self._change), weights)
        self._base = light - change
        self._exposed = ExposedRows(
            layout, weights, self._change, self._base, response=model.response
        )
        self._expose = [self._exposed.of(band.rows) for band in self._bands]

    @property
    def gain(self) -> Float32Array | None:
        """What the model's change is multiplied by, [3, height, width]; None is 1."""
        return self._gain

    @property
    def base(self) -> Float32Array:
        """No-contact frame's light less the unloaded gel's [grey levels], [3, height, width]."""
        return self._base

    def render(self, height: NDArray[np.floating]) -> ImageArray:
        """Return the image of a height map [m] as RGB, uint8, shape [height, width, 3]."""
        _check_shape("height map", height.shape, self._rest_height.shape)
        self._find_change(height)
        self._threads.run(self._expose[::2], self._expose[1::2])
        return self._exposed.image()

    def _find_change(self, height: NDArray[np.floating]) -> None:
        """Find the mean change of colour of each pixel's samples."""
        if self._shadows is not None:
            lamps = self._shadows.follow(height)
            self._threads.run(lamps[::2], lamps[1::2])
        tasks = [
            partial(_sample_and_colour, band, colours, height)
            for band, colours in zip(self._bands, self._colour, strict=True)
        ]
        self._threads.run(tasks[::2], tasks[1::2])

    def _coloured(self, band: SampledBand) -> list[Task]:
        tasks = [self._colours.over(band, self._change)]
        if self._gain is not None:
            change = self._pixels_of(self._change)[:, band.rows]
            tasks.append(partial(np.multiply, change, self._gain[:, band.rows], change))
        return tasks if self._shadows is None else tasks + self._shadows.over(band, self._change)

    def _pixels_of(self, planes: Planes) -> Float32Array:
        return planes.values[:, :, LANES : LANES + self._geometry.width]


def _sample_and_colour(
    band: SampledBand, colours: Sequence[Task], height: NDArray[np.floating]
) -> None:
    band.sample(height)
    for colour in colours:
        colour()


def _check_shape(name: str, shape: tuple[int, ...], expected: tuple[int, ...]) -> None:
    if shape != expected:
        raise ConfigError(
            f"{name} has the shape {shape}, the sensor's camera {expected}",
            remedy="bring frames to the sensor's size, and use one geometry throughout",
        )
