"""Photometric model: tilt and place of the surface to a change of colour.

After Taxim (Si and Yuan 2022), who map slope to colour with a low-order polynomial in pixel
position; here the whole map is one polynomial with coefficients as data.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from sim.arrays import FloatArray, IntArray
from sim.optics.tilt import Float32Array
from tacauchy_rig.errors import ConfigError

FORMAT = "tacauchy photometric model 1"


@dataclass(frozen=True, slots=True, kw_only=True)
class PhotometricModel:
    """Polynomial in tilt (p, q) and normalised pixel position (u, v) for three colours.

    colour change = sum_k coefficient_k p^a_k q^b_k u^c_k v^d_k, with a + b >= 1.

    Attributes:
        exponents: a, b, c, d of each term, shape [term_count, 4].
        coefficients: Grey levels of red, green, blue for each term, shape [term_count, 3].
        tilt_limit: Largest tilt the coefficients were fitted to; steeper surfaces are rendered
            as this steep in their own direction, not extrapolated.
        provenance: Where the coefficients come from, as JSON values with units in the keys.
    """

    exponents: IntArray
    coefficients: FloatArray
    tilt_limit: float = 1.0
    provenance: Mapping[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.exponents.shape != (len(self.coefficients), 4) or self.coefficients.shape[1:] != (
            3,
        ):
            raise ConfigError(
                f"photometric model has exponents of shape {self.exponents.shape} and "
                f"coefficients of shape {self.coefficients.shape}",
                remedy="they must be [terms, 4] and [terms, 3]",
            )

    def evaluate(self, tilt: Float32Array, position: Float32Array) -> Float32Array:
        """Return the colour change [grey levels].

        Args:
            tilt: Shape [2, point_count].
            position: Normalised pixel position, shape [2, point_count].

        Returns:
            Red, green, blue, shape [3, point_count].
        """
        steepness = np.sqrt(tilt[0] * tilt[0] + tilt[1] * tilt[1])
        shrink = self.tilt_limit / np.maximum(steepness, np.float32(self.tilt_limit))
        features = monomials(tilt * shrink, position, self.exponents)
        return np.asarray(self.coefficients.T.astype(np.float32) @ features, dtype=np.float32)

    def save(self, path: Path) -> None:
        """Write the model and its provenance as one ``.npz``."""
        np.savez(
            path,
            format=np.array(FORMAT),
            exponents=self.exponents,
            coefficients=self.coefficients,
            tilt_limit=np.array(self.tilt_limit),
            provenance=np.array(json.dumps(dict(self.provenance), sort_keys=True)),
        )


def load_photometric(path: Path) -> PhotometricModel:
    """Read a model written by ``PhotometricModel.save``.

    Raises:
        ConfigError: The file is missing or is not such a model.
    """
    remedy = "write one with: tacauchy-rig calibrate optics FOLDER ... --out calibration.npz"
    try:
        with np.load(path, allow_pickle=False) as data:
            if str(data["format"]) != FORMAT:
                raise ConfigError(f"{path} has the format {str(data['format'])!r}", remedy=remedy)
            return PhotometricModel(
                exponents=data["exponents"],
                coefficients=data["coefficients"],
                tilt_limit=float(data["tilt_limit"]),
                provenance=json.loads(str(data["provenance"])),
            )
    except FileNotFoundError as error:
        raise ConfigError(f"optics calibration {path} does not exist", remedy=remedy) from error
    except (OSError, ValueError, KeyError, BadZipFile) as error:
        raise ConfigError(
            f"{path} is not an optics calibration ({error})", remedy=remedy
        ) from error


def normalised_positions(height: int, width: int) -> Float32Array:
    """Return u, v in [-1, 1] over columns and rows, shape [2, height * width]."""
    v, u = np.meshgrid(np.linspace(-1, 1, height), np.linspace(-1, 1, width), indexing="ij")
    return np.stack([u.ravel(), v.ravel()]).astype(np.float32)


def polynomial_exponents(*, tilt_degree: int, position_degree: int) -> IntArray:
    """List the terms p^a q^b u^c v^d with 1 <= a + b <= tilt_degree, c + d <= position_degree.

    Returns:
        Exponents, shape [term_count, 4].
    """
    terms = [
        (a, total - a, c, place - c)
        for place in range(position_degree + 1)
        for c in range(place, -1, -1)
        for total in range(1, tilt_degree + 1)
        for a in range(total, -1, -1)
    ]
    return np.array(terms, dtype=np.int32).reshape(-1, 4)


def monomials(tilt: Float32Array, position: Float32Array, exponents: IntArray) -> Float32Array:
    """Return the terms' values, shape [term_count, point_count]; arguments as in ``evaluate``."""
    variables = (tilt[0], tilt[1], position[0], position[1])
    one = np.ones_like(tilt[0])
    powers = [
        _powers(variable, one, int(exponents[:, i].max(initial=0)))
        for i, variable in enumerate(variables)
    ]
    in_tilt: dict[tuple[int, int], NDArray[np.float32]] = {}
    features = np.empty((len(exponents), tilt.shape[1]), dtype=tilt.dtype)
    for row, (a, b, c, d) in zip(features, exponents.tolist(), strict=True):
        if (a, b) not in in_tilt:
            in_tilt[a, b] = powers[0][a] * powers[1][b]
        np.multiply(in_tilt[a, b], powers[2][c], out=row)
        if d:
            row *= powers[3][d]
    return features


def _powers(variable: Float32Array, one: Float32Array, degree: int) -> list[Float32Array]:
    powers = [one]
    for _ in range(degree):
        powers.append(powers[-1] * variable)
    return powers
