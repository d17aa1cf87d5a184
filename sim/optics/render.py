"""From height maps to the tactile image of a colour-lit sensor."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sim.optics.gaussian import blurred, gaussian_weights
from sim.optics.geometry import CameraGeometry, ImageArray
from sim.optics.photometric import normalised_positions
from sim.optics.polynomial import RealArray
from sim.optics.shadow import ShadowCaster
from sim.optics.tilt import surface_tilt
from tacauchy_rig.errors import ConfigError


class ColourModel(Protocol):
    """Change of colour that a surface brings."""

    def evaluate(self, tilt: RealArray, position: RealArray, indentation_m: RealArray) -> RealArray:
        """Return red, green, blue [grey levels], [3, n], from [2, n], [2, n] and [n]."""
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
        self._model = model
        _check_shape("no-contact frame", background.shape, (geometry.height, geometry.width, 3))
        self._position = normalised_positions(geometry.height, geometry.width, samples=samples)
        _check_shape(
            "unloaded height map", rest_height.shape, (self._fine.height, self._fine.width)
        )
        self._rest_height = rest_height
        levels = background.astype(np.float32).reshape(-1, 3).T
        self._base = levels - self._colour(rest_height)

    @property
    def base(self) -> RealArray:
        """No-contact frame less the unloaded gel's colour [grey levels], shape [3, pixel_count]."""
        return self._base

    def render(self, height: NDArray[np.floating]) -> ImageArray:
        """Return the image of a height map [m] as RGB, uint8, shape [height, width, 3]."""
        _check_shape("height map", height.shape, self._rest_height.shape)
        levels = self._base + self._colour(height)
        levels += np.float32(0.5)
        np.clip(levels, 0.0, 255.0, out=levels)
        shape = (self._geometry.height, self._geometry.width, 3)
        return np.ascontiguousarray(levels.T.astype(np.uint8).reshape(shape))

    def _colour(self, height: NDArray[np.floating]) -> RealArray:
        tilt = surface_tilt(height, self._fine).reshape(2, -1)
        indentation = (self._rest_height - height).astype(np.float32).ravel()
        change = self._model.evaluate(tilt, self._position, indentation)
        if self._shadows is not None:
            shape = self._rest_height.shape
            taken = self._shadows.darkening(
                indentation.reshape(shape), tilt.reshape(2, *shape), self._fine
            )
            change = np.asarray(change + taken.reshape(3, -1))
        return self._gathered(change)

    def _gathered(self, change: RealArray) -> RealArray:
        """Average the samples of each pixel and blur, shape [3, pixel_count]."""
        height, width = self._geometry.height, self._geometry.width
        if self._samples > 1:
            split = change.reshape(3, height, self._samples, width, self._samples)
            change = split.mean(axis=(2, 4))
        planes = blurred(change.reshape(3, height, width), self._weights)
        return np.asarray(planes.reshape(3, -1))


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
