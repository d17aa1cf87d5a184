"""The pixels of a press, as samples for a fit of colours."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np

from sim.optics.calibrate.fit.photometric_fit import REFERENCE
from sim.optics.calibrate.fit.samples import PhotometricSamples, SurfacePoints
from sim.optics.calibrate.presses.light import light_weights, seen_change
from sim.optics.calibrate.presses.scene import PlacedPress, PredictedPixels, PressScene
from sim.optics.colour.photometric import PhotometricModel
from sim.optics.colour.response import Response


class PressSamples:
    """Pixels around a contact; their surface is the same through every camera's response.

    Args:
        blur_px: Standard deviation of the camera's blur [px].
        every: Only so many-th pixel is taken.

    Attributes:
        surface: The samples, without their colours.
    """

    def __init__(
        self,
        scene: PressScene,
        placed: PlacedPress,
        *,
        blur_px: float = 0.0,
        every: int = 1,
    ) -> None:
        press, circle = placed.press, placed.circle
        rows, columns = (places[::every] for places in scene.pixels_around(press.circle))
        self._scene, self._circle, self._columns, self._rows = scene, circle, columns, rows
        self._levels = press.image[rows, columns]
        self._expected = scene.expected(rows, columns, placed.light)
        self._unloaded = scene.background[rows, columns]
        unknown = np.zeros_like(self._expected.T)
        self.surface = PhotometricSamples(
            gel=scene.surface(circle, columns, rows),
            position=scene.normalised(columns, rows),
            change=unknown,
            weights=unknown,
            rest=scene.at_rest(columns, rows),
            around=self._blurred_over(blur_px),
        )

    def through(
        self, response: Response, model: PhotometricModel | None = None
    ) -> PhotometricSamples:
        """Return the samples with the light that the camera saw.

        Args:
            model: Stands in for pixels that are too bright or too dark for the camera; without
                one they do not count.
        """
        seen = seen_change(self._levels, self._expected, response)
        gain = np.maximum(response.light(self._unloaded), 1.0) / REFERENCE
        change, weights = seen.change, gain * light_weights(self._levels, response)
        if model is None:
            weights *= seen.exposed
        else:
            lost = np.flatnonzero(~seen.exposed.all(axis=1))
            pixels = PredictedPixels(self._scene, model, self._columns[lost], self._rows[lost])
            predicted = change.copy()
            predicted[lost] = gain[lost] * pixels.light_change(self._circle)
            change = seen.completed(predicted)
        return replace(self.surface, change=(change / gain).T, weights=weights.T)

    def _blurred_over(self, blur_px: float) -> tuple[SurfacePoints, ...]:
        """Return four points around each pixel whose mean a Gaussian blur is, to third order."""
        if blur_px == 0.0:
            return ()
        height, width = self._scene.background.shape[:2]
        found = []
        for right, down in product((-blur_px, blur_px), repeat=2):
            x = np.clip(self._columns + right, 0.0, width - 1.0)
            y = np.clip(self._rows + down, 0.0, height - 1.0)
            found.append(self._scene.surface(self._circle, x, y))
        return tuple(found)
