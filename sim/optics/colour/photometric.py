"""Photometric model: tilt, place and indentation of the surface to a change of colour.

After Taxim (Si and Yuan 2022), who map slope to colour with a low-order polynomial in pixel
position; here the whole map is one polynomial with coefficients as data. It also knows how deep
the surface is pressed: under a ball's centre the gel is level as at rest, and yet darker. A
calibration may add near lamps and creases (``shading_terms``), which no polynomial follows.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import warp as wp
from pydantic import TypeAdapter

from sim.device import filled
from sim.optics.colour.colour_kernel import Colours, colour_pixels
from sim.optics.colour.colour_model import BRIGHTEST, LINEAR, PixelColours, Response
from sim.optics.colour.model_terms import (
    ShadingTerms,
    degrees_of_tilt,
    evaluate_polynomial,
    lamp_planes,
    lamp_weights,
    row_weights,
)
from sim.optics.pixels.pixel_blocks import PixelBlocks
from tacauchy_rig.core.arrays import Float32Array, FloatArray, IntArray, RealArray
from tacauchy_rig.core.errors import ConfigError

FORMAT = "tacauchy photometric model 1"
_NO_LIMIT_M = 1e3  # deeper than any gel


@dataclass(frozen=True, slots=True, kw_only=True)
class PhotometricModel:
    """Polynomial in tilt (p, q), normalised pixel position (u, v) and indentation w [mm].

    colour change = sum_k coefficient_k p^a_k q^b_k u^c_k v^d_k w^e_k, with a + b + e >= 1.
    It is a change of light, in grey levels below the camera's knee; see ``Response``.

    Attributes:
        exponents: a, b, c, d, e of each term, shape [term_count, 5].
        coefficients: Grey levels of red, green, blue for each term, shape [term_count, 3].
        tilt_limit: Largest tilt the coefficients were fitted to; steeper surfaces are rendered
            as this steep in their own direction, not extrapolated.
        indentation_limit_m: Largest indentation the coefficients were fitted to [m], likewise.
        terms: Lamps and creases, not bounded by the limit of tilt; None has none.
        term_coefficients: Grey levels of red, green, blue for each of them, shape [count, 3].
        reference: Grey level of a no-contact frame to which the change holds; where the frame is
            brighter or darker, the change of light is so too, as paint and lamps shade both alike.
            None adds the same everywhere.
        provenance: Where the coefficients come from, as JSON values with units in the keys.
    """

    exponents: IntArray
    coefficients: FloatArray
    tilt_limit: float = 1.0
    indentation_limit_m: float = math.inf
    terms: ShadingTerms | None = None
    term_coefficients: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    response: Response = LINEAR
    reference: float | None = None
    provenance: Mapping[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        terms = len(self.coefficients)
        if self.exponents.shape != (terms, 5) or self.coefficients.shape != (terms, 3):
            raise ConfigError(
                f"photometric model has exponents of shape {self.exponents.shape} and "
                f"coefficients of shape {self.coefficients.shape}",
                remedy="they must be [terms, 5] and [terms, 3]",
            )

    def evaluate(
        self,
        tilt: RealArray,
        position: RealArray,
        indentation_m: RealArray,
        curvature: RealArray | None = None,
    ) -> RealArray:
        """Return the change of red, green, blue [grey levels] in the precision of the arguments.

        Args:
            tilt: Shape [2, point_count].
            position: Normalised pixel position, shape [2, point_count].
            indentation_m: Unloaded minus loaded height [m], shape [point_count].
            curvature: Divergence of the tilt [1/m], shape [point_count]; None is no crease.
        """
        bounded = bounded_tilt(tilt, self.tilt_limit)
        depth = np.minimum(indentation_m, self.indentation_limit_m)
        change = evaluate_polynomial(self.exponents, self.coefficients, bounded, position, depth)
        if self.terms is not None:
            creases = np.zeros_like(indentation_m) if curvature is None else curvature
            values = self.terms.values(tilt, position, creases)
            change += self.term_coefficients.T.astype(tilt.dtype) @ values
        return change

    def gain(self, light: RealArray) -> RealArray:
        """Return what the change is multiplied by over a no-contact frame's light [grey levels]."""
        if self.reference is None:
            return np.ones_like(light)
        return np.asarray(np.maximum(light, 1.0) * (1.0 / self.reference))

    def over(self, frame: Float32Array, layout: PixelBlocks) -> PixelColours:
        """Make it ready for a no-contact frame [grey levels], shape [3, height, width]."""
        light = np.asarray(self.response.light(frame), dtype=np.float32)
        height, width = layout.geometry.height, layout.geometry.width
        position = normalised_positions(height, width)
        inputs = [
            self._colours(position[1, ::width], layout),
            layout.pixel_rows(position[:1, :width])[0],
            lamp_planes(self.terms, position, layout),
            layout.pixel_rows(self.gain(light)),
        ]
        return PixelColours(
            light=light, response=self.response, kernel=colour_pixels, inputs=inputs
        )

    def _colours(self, v: Float32Array, layout: PixelBlocks) -> Any:
        terms = self.terms
        degrees = degrees_of_tilt(self.exponents)
        weights = row_weights(self.exponents, self.coefficients, degrees, v)
        return filled(
            Colours,
            tilt_limit=self.tilt_limit,
            depth_limit=min(self.indentation_limit_m, _NO_LIMIT_M),
            along_powers=degrees.shape[0],
            depth_powers=degrees.shape[1],
            degrees=wp.array(degrees.ravel(), dtype=wp.int32, device=layout.device),
            weight_count=weights.shape[1] * 3,
            weights=layout.array(weights.ravel()),
            lamp_count=0 if terms is None else len(terms.lamps),
            bend=0.0 if terms is None else terms.softness**2,
            crease_limit=0.0 if terms is None else terms.crease_limit,
            lamp_weights=layout.array(lamp_weights(terms, self.term_coefficients, v).ravel()),
        )

    def save(self, path: Path) -> None:
        """Write the model and its provenance as one ``.npz``."""
        np.savez(
            path,
            format=np.array(FORMAT),
            exponents=self.exponents,
            coefficients=self.coefficients,
            tilt_limit=np.array(self.tilt_limit),
            indentation_limit_m=np.array(self.indentation_limit_m),
            terms=np.array(json.dumps(None if self.terms is None else asdict(self.terms))),
            term_coefficients=self.term_coefficients,
            knee=np.array(self.response.knee),
            reference=np.array(math.nan if self.reference is None else self.reference),
            provenance=np.array(json.dumps(dict(self.provenance), sort_keys=True)),
        )


def load_photometric(path: Path) -> PhotometricModel:
    """Read a model written by ``PhotometricModel.save``.

    Raises:
        ConfigError: The file is missing or is not such a model.
    """
    remedy = "write one with: tacauchy-rig calibrate optics FOLDER ... --out calibration.npz"
    if path.exists() and not path.is_file():
        raise ConfigError(f"{path} is no plain file", remedy=remedy)
    try:
        with np.load(path, allow_pickle=False) as data:
            if str(data["format"]) != FORMAT:
                raise ConfigError(f"{path} has the format {str(data['format'])!r}", remedy=remedy)
            terms = json.loads(str(data["terms"])) if "terms" in data else None
            reference = float(data["reference"]) if "reference" in data else math.nan
            return PhotometricModel(
                exponents=data["exponents"],
                coefficients=data["coefficients"],
                tilt_limit=float(data["tilt_limit"]),
                indentation_limit_m=float(data["indentation_limit_m"]),
                terms=TypeAdapter(ShadingTerms | None).validate_python(terms),
                term_coefficients=data["term_coefficients"] if terms else np.zeros((0, 3)),
                response=Response(knee=float(data["knee"]) if "knee" in data else BRIGHTEST),
                reference=None if math.isnan(reference) else reference,
                provenance=json.loads(str(data["provenance"])),
            )
    except FileNotFoundError as error:
        raise ConfigError(f"optics calibration {path} does not exist", remedy=remedy) from error
    except (OSError, EOFError, ValueError, KeyError, TypeError, BadZipFile) as error:
        raise ConfigError(
            f"{path} is not an optics calibration ({error})", remedy=remedy
        ) from error


def bounded_tilt(tilt: RealArray, limit: float) -> RealArray:
    """Return tilts no steeper than a limit, in their own direction; shape [2, ...]."""
    steepness = np.sqrt(tilt[0] * tilt[0] + tilt[1] * tilt[1])
    return np.asarray(tilt * (limit / np.maximum(steepness, limit)))


def normalised_positions(height: int, width: int) -> Float32Array:
    """Return u, v over columns and rows, shape [2, height * width].

    They are -1 and 1 in the middle of the first and last pixel.
    """
    v, u = np.meshgrid(np.linspace(-1, 1, height), np.linspace(-1, 1, width), indexing="ij")
    return np.stack([u.ravel(), v.ravel()]).astype(np.float32)
