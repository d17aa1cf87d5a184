"""From height maps to the tactile image of a colour-lit sensor."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sim.optics.gaussian import gaussian_weights, inner_blurred
from sim.optics.geometry import CameraGeometry, ImageArray
from sim.optics.photometric import normalised_positions
from sim.optics.polynomial import IndexArray, RealArray
from sim.optics.shadow import ShadowCaster
from sim.optics.tilt import Float32Array, surface_tilt, tilt_divergence
from tacauchy_rig.errors import ConfigError

# So much of every array stays in the cache together.
_BAND_PIXELS = 12_800
# Where a pixel's samples are tilted alike to this, the colour of their mean is their mean colour.
_LEVEL_TILT = 0.01


class PixelColours(Protocol):
    """Mean change of colour of pixels' samples [grey levels], shape [3, n]."""

    def rows(
        self, rows: slice, tilt: RealArray, indentation_m: RealArray, curvature: RealArray | None
    ) -> RealArray:
        """Return that of whole rows of an image, from [2, s, n], [s, n] and [s, n]."""
        ...

    def scattered(
        self,
        pixels: IndexArray,
        tilt: RealArray,
        indentation_m: RealArray,
        curvature: RealArray | None,
    ) -> RealArray:
        """Return that of pixels anywhere in the image."""
        ...


class ColourModel(Protocol):
    """Change of colour that a surface brings."""

    @property
    def sees_curvature(self) -> bool:
        """Whether ``evaluate`` wants the surface's curvature."""
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

    def of_pixels(self, position: RealArray, columns: int) -> PixelColours:
        """Return it made ready for an image's pixels, their places row after row [2, n]."""
        ...


class TactileRenderer:
    """Renders height maps over one no-contact frame.

    image = no-contact frame + model(loaded gel) - model(unloaded gel), less the shadows that the
    dent casts: the unloaded gel gives back the no-contact frame exactly.

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
        self._geometry = geometry
        self._fine = geometry.refined(samples)
        self._samples, self._weights = samples, gaussian_weights(blur_px)
        self._shadows = shadows
        self._sees_curvature = model.sees_curvature
        _check_shape("no-contact frame", background.shape, (geometry.height, geometry.width, 3))
        places = normalised_positions(geometry.height, geometry.width)
        self._colours = model.of_pixels(places, geometry.width)
        _check_shape(
            "unloaded height map", rest_height.shape, (self._fine.height, self._fine.width)
        )
        self._rest_height = rest_height
        band = max(1, _BAND_PIXELS // geometry.width)
        self._bands = [
            slice(start, min(start + band, geometry.height))
            for start in range(0, geometry.height, band)
        ]
        change = inner_blurred(self._change(rest_height), self._weights)
        self._base = background.astype(np.float32).transpose(2, 0, 1) - change

    @property
    def base(self) -> Float32Array:
        """No-contact frame less the unloaded gel's colour [grey levels], [3, height, width]."""
        return self._base

    def render(self, height: NDArray[np.floating]) -> ImageArray:
        """Return the image of a height map [m] as RGB, uint8, shape [height, width, 3]."""
        _check_shape("height map", height.shape, self._rest_height.shape)
        image = np.empty((self._geometry.height, self._geometry.width, 3), dtype=np.uint8)
        change, reach = self._change(height), len(self._weights) // 2
        for rows in self._bands:
            levels = inner_blurred(change[:, rows.start : rows.stop + 2 * reach], self._weights)
            levels += self._base[:, rows]
            levels += np.float32(0.5)
            np.clip(levels, 0.0, 255.0, out=levels)
            image[rows] = levels.transpose(1, 2, 0)
        return image

    def _change(self, height: NDArray[np.floating]) -> Float32Array:
        """Return the mean change of colour of each pixel's samples, with room for the blur.

        Returns:
            Shape [3, height + 2 reach, width + 2 reach], mirrored at the border.
        """
        rows, columns = self._geometry.height, self._geometry.width
        change = np.empty((3, rows * columns), dtype=np.float32)
        bent: list[tuple[IndexArray, Float32Array]] = []
        shaded = None if self._shadows is None else np.empty((3, *height.shape), dtype=np.float32)
        for band in self._bands:
            surface = self._surface(band, height)
            if shaded is not None:
                shaded[:, band.start * self._samples : band.stop * self._samples] = surface[:3]
            planes = self._planes(surface)
            first, middle = band.start * columns, _mean_of_samples(planes)
            pixels = slice(first, band.stop * columns)
            change[:, pixels] = self._colours.rows(band, middle[:2], middle[2], self._bend(middle))
            found = _bent(planes, middle)
            bent.append((found + first, planes[:, :, found]))
        places = np.concatenate([indices for indices, _ in bent])
        if len(places):
            planes = np.concatenate([samples for _, samples in bent], axis=2)
            bend = self._bend(planes)
            change[:, places] = self._colours.scattered(places, planes[:2], planes[2], bend)
        image = change.reshape(3, rows, columns)
        if self._shadows is not None and shaded is not None:
            image += self._shadows.darkening(
                shaded[2], shaded[:2], self._fine, samples=self._samples
            )
        reach = len(self._weights) // 2
        return np.pad(image, ((0, 0), (reach, reach), (reach, reach)), mode="reflect")

    def _bend(self, planes: Float32Array) -> Float32Array | None:
        return planes[3] if self._sees_curvature else None

    def _surface(self, rows: slice, height: NDArray[np.floating]) -> Float32Array:
        """Return tilt, indentation and, where it is seen, curvature of a band of pixels.

        Returns:
            Shape [3 or 4, rows, columns] of samples.
        """
        fine = slice(rows.start * self._samples, rows.stop * self._samples)
        above = max(fine.start - 2, 0)
        inner = slice(fine.start - above, fine.stop - above)
        tilt = surface_tilt(height[above : fine.stop + 2], self._fine)
        layers = 4 if self._sees_curvature else 3
        surface = np.empty((layers, fine.stop - fine.start, height.shape[1]), dtype=np.float32)
        surface[:2] = tilt[:, inner]
        surface[2] = self._rest_height[fine] - height[fine]
        if self._sees_curvature:
            surface[3] = tilt_divergence(tilt, self._fine)[inner]
        return surface

    def _planes(self, surface: Float32Array) -> Float32Array:
        """Return the samples of each pixel together, shape [3 or 4, sample_count, pixel_count]."""
        samples, columns = self._samples, self._geometry.width
        split = surface.reshape(len(surface), -1, samples, columns, samples)
        planes = np.ascontiguousarray(split.transpose(0, 2, 4, 1, 3))
        return planes.reshape(len(surface), samples**2, -1)


def _mean_of_samples(planes: Float32Array) -> Float32Array:
    middle = np.add.reduce(planes, axis=1, keepdims=True)
    middle *= np.float32(1.0 / planes.shape[1])
    return np.asarray(middle)


def _bent(planes: Float32Array, middle: Float32Array) -> IndexArray:
    """Return which pixels' samples are tilted so unlike that each has to be looked at."""
    if planes.shape[1] == 1:
        return np.empty(0, dtype=np.int64)
    apart = np.abs(planes[:2] - middle[:2]).reshape(-1, planes.shape[2])
    return np.flatnonzero(np.maximum.reduce(apart, axis=0) > _LEVEL_TILT)


def render_tactile_image(
    height: NDArray[np.floating],
    rest_height: NDArray[np.floating],
    background: ImageArray,
    model: ColourModel,
    *,
    geometry: CameraGeometry,
) -> ImageArray:
    """Render one image; ``TactileRenderer`` spares the unloaded part where many are rendered.

    Args:
        height: Height map of the loaded gel [m], shape [height, width].
        rest_height: Height map of the unloaded gel [m], same shape.
        background: No-contact frame, RGB, shape [height, width, 3].
        model: Colour of a tilt.
        geometry: Pixels.

    Returns:
        RGB, uint8, shape [height, width, 3].
    """
    return TactileRenderer(background, rest_height, model, geometry).render(height)


def _check_shape(name: str, shape: tuple[int, ...], expected: tuple[int, ...]) -> None:
    if shape != expected:
        raise ConfigError(
            f"{name} has the shape {shape}, the sensor's camera {expected}",
            remedy="bring frames to the sensor's size, and use one geometry throughout",
        )
