"""The photometric model over the pixels of one image, made ready for many surfaces.

What depends on a pixel's place alone is summed beforehand: the polynomial's powers of v for each
row, and each near lamp's direction and colour for each pixel.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sim.optics.polynomial import IndexArray, RealArray, polynomial_plan, sum_places, surface_means
from sim.optics.shading_terms import CREASE_UNIT_M, softened
from sim.optics.tilt import bounded_tilt

if TYPE_CHECKING:
    from sim.optics.photometric import PhotometricModel


class PhotometricPixels:
    """Mean colours of pixels' samples.

    Args:
        model: Colour of a surface.
        position: Normalised place of every pixel, row after row, shape [2, height * width].
        columns: Width of the image.
    """

    def __init__(self, model: PhotometricModel, position: RealArray, columns: int) -> None:
        self._model, self._position, self._columns = model, position, columns
        self._plan = polynomial_plan(model.exponents, model.coefficients, np.dtype(np.float32))
        plan = self._plan
        self._surface = plan.surface[:, [0, 1, 4]]
        self._along, across = (max(place[k] for place in plan.places) + 1 for k in (0, 1))
        grid = np.zeros((self._along, across, 3, len(self._surface)), dtype=np.float32)
        by_place = plan.weights.reshape(-1, 3, len(self._surface))
        for place, weights in zip(plan.places, by_place, strict=True):
            grid[place] = weights
        v_powers = np.vander(position[1, ::columns], across, increasing=True)
        weights = np.einsum("rd,cdks->rcks", v_powers.astype(np.float32), grid)
        self._row_weights = weights.reshape(len(weights), -1, len(self._surface))
        self._lamps, self._colours = _lamp_planes(model, position)

    def rows(
        self, rows: slice, tilt: RealArray, indentation_m: RealArray, curvature: RealArray | None
    ) -> RealArray:
        """Return red, green, blue [grey levels] of whole rows, shape [3, pixel_count].

        Args:
            rows: Of the image.
            tilt: Shape [2, sample_count, pixel_count].
            indentation_m: Shape [sample_count, pixel_count].
            curvature: Divergence of the tilt [1/m], likewise; None where no model sees it.
        """
        features = self._features(tilt, indentation_m)
        count, columns = rows.stop - rows.start, self._columns
        split = features.reshape(-1, count, columns).transpose(1, 0, 2)
        parts = (self._row_weights[rows] @ split).reshape(count, self._along, 3, columns)
        total = parts[:, self._along - 1]
        for power in range(self._along - 2, -1, -1):
            total *= self._position[0, :columns]
            total += parts[:, power]
        change = np.ascontiguousarray(total.transpose(1, 0, 2)).reshape(3, -1)
        pixels = slice(rows.start * columns, rows.stop * columns)
        return self._shaded(change, pixels, tilt, curvature)

    def scattered(
        self,
        pixels: IndexArray,
        tilt: RealArray,
        indentation_m: RealArray,
        curvature: RealArray | None,
    ) -> RealArray:
        """Return the same of pixels anywhere in the image."""
        features = self._features(tilt, indentation_m)
        change = np.empty((3, len(pixels)), dtype=np.float32)
        sum_places(self._plan, features, self._position[:, pixels], change)
        return self._shaded(change, pixels, tilt, curvature)

    def _features(self, tilt: RealArray, indentation_m: RealArray) -> RealArray:
        depth = np.minimum(indentation_m, np.float32(self._model.indentation_limit_m))
        return surface_means(self._surface, bounded_tilt(tilt, self._model.tilt_limit), depth)

    def _shaded(
        self,
        change: RealArray,
        pixels: slice | IndexArray,
        tilt: RealArray,
        curvature: RealArray | None,
    ) -> RealArray:
        """Add near lamps and creases, see ``shading_terms``."""
        terms = self._model.terms
        if terms is None or curvature is None:
            return change
        upright = np.sqrt(np.maximum(1.0 - tilt[0] ** 2 - tilt[1] ** 2, np.float32(0.0)))
        for plane, colours in zip(self._lamps, self._colours[:-1], strict=True):
            along, across, height, level = plane[:, pixels]
            cosine = tilt[0] * along
            cosine += tilt[1] * across
            cosine += upright * height
            lit = _mean(softened(cosine, terms.softness)) - level
            change += colours[:, pixels] * lit
        crease = _mean(np.clip(curvature, -terms.crease_limit, terms.crease_limit))
        change += self._colours[-1][:, pixels] * (crease * np.float32(CREASE_UNIT_M))
        return change


def _mean(samples: RealArray) -> RealArray:
    """Return the mean over the first axis."""
    return samples[0] if len(samples) == 1 else np.asarray(samples.mean(axis=0))


def _lamp_planes(
    model: PhotometricModel, position: RealArray
) -> tuple[list[RealArray], list[RealArray]]:
    """Return each lamp's direction and light on level gel, and each term's colours, by pixel.

    Returns:
        Shapes [4, pixel_count] for each lamp, [3, pixel_count] for each lamp and for creases.
    """
    if model.terms is None:
        return [], []
    place = np.stack([position[0], position[1] * np.float32(model.terms.aspect)])
    lamps = [lamp.seen_from(place, softness=model.terms.softness) for lamp in model.terms.lamps]
    basis = np.stack([np.ones_like(position[0]), *position])
    weights = model.term_coefficients.astype(np.float32).reshape(len(lamps) + 1, 3, 3)
    return lamps, [each.T @ basis for each in weights]
