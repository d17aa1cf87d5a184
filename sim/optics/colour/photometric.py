"""Photometric model: tilt, place and indentation of the surface to a change of colour.

One polynomial with coefficients as data, after Taxim (Si and Yuan 2022), and linear terms of near
lamps (by the cosine of the angle, none beyond the terminator: Lambert) and creases (scattered light
reaches a ridge from more sides than a groove), with level and gradient over the image each; these
terms vanish on level gel.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import BadZipFile

import numpy as np
from pydantic import TypeAdapter

from sim.optics.colour.model_interface_and_response import (
    BRIGHTEST,
    CREASE_UNIT_M,
    INDENTATION_UNIT_M,
    LINEAR,
    PixelColours,
    Response,
)
from tacauchy_rig.core.arrays import Float32Array, FloatArray, IndexArray, IntArray, RealArray
from tacauchy_rig.core.errors import ConfigError

if TYPE_CHECKING:
    from sim.optics.pixels.pixel_blocks import PixelBlocks

FORMAT = "tacauchy photometric model 1"
_NO_LIMIT_M = 1e3  # deeper than any gel
_DIGITS = 16 ** np.arange(5)  # of a number for each term: no exponent reaches 16


def polynomial_exponents(
    tilt_degree: int,
    position_degree: int,
    indentation_degree: int = 0,
    indentation_tilt_degree: int = 0,
) -> IntArray:
    """List the exponents of the terms p^a q^b u^c v^d w^e of a model, shape [term_count, 5].

    Terms without indentation have 1 <= a + b <= tilt_degree; terms with 1 <= e <=
    indentation_degree have a + b <= indentation_tilt_degree; all have c + d <= position_degree.
    """
    tilts = [
        (a, total - a, e)
        for e in range(indentation_degree + 1)
        for total in range(0 if e else 1, (indentation_tilt_degree if e else tilt_degree) + 1)
        for a in range(total, -1, -1)
    ]
    terms = [
        (a, b, c, place - c, e)
        for place in range(position_degree + 1)
        for c in range(place, -1, -1)
        for a, b, e in tilts
    ]
    return np.array(terms, dtype=np.int32).reshape(-1, 5)


def _bent(*degrees: tuple[int, int, int, int]) -> IntArray:
    """List terms once, by degrees of tilt, place, indentation, and of tilt beside indentation."""
    return np.unique(np.concatenate([polynomial_exponents(*each) for each in degrees]), axis=0)


# Light falls off over the image: gentle slopes' colours bend with place, steep ones' do not.
BALL_EXPONENTS = _bent((4, 1, 2, 2), (3, 2, 1, 1), (1, 4, 1, 0))
# Where lamps graze the gel, those of steep slopes do too.
GRAZED_EXPONENTS = _bent((4, 1, 2, 2), (3, 2, 1, 1), (2, 4, 1, 2))


def monomials(
    tilt: RealArray, position: RealArray, indentation_m: RealArray, exponents: IntArray
) -> RealArray:
    """Return the terms' values at n points, shape [term_count, n].

    Exponents, shape [term_count, 5], are of tilt (2), position (2) and indentation [mm].
    """
    depth = indentation_m / INDENTATION_UNIT_M
    powers = [[variable, variable] for variable in (*tilt, *position, depth)]
    for known, degree in zip(powers, exponents.max(axis=0, initial=0), strict=True):
        while len(known) <= degree:
            known.append(known[-1] * known[1])
    values = np.ones((len(exponents), tilt.shape[1]), dtype=tilt.dtype)
    for row, term in zip(values, exponents.tolist(), strict=True):
        for known, power in zip(powers, term, strict=True):
            if power:
                row *= known[power]
    return values


def shapes_and_places(exponents: IntArray) -> list[tuple[IntArray, IndexArray]]:
    """Return terms' factors of the surface, and of position: each once, and which each term has."""
    parts = exponents * (1, 1, 0, 0, 1), exponents * (0, 0, 1, 1, 0)
    found = [np.unique(part @ _DIGITS, return_index=True, return_inverse=True) for part in parts]
    return [(part[first], which) for part, (_, first, which) in zip(parts, found, strict=True)]


def row_weights(
    exponents: IntArray, coefficients: FloatArray, v: RealArray
) -> tuple[IntArray, Float32Array]:
    """Return the terms as the kernel comes to them.

    They are the highest degree of tilt at powers of u (falling) and indentation, -1 for none, and
    the coefficients of each row of pixels, shape [row, term, 3].
    """
    along, deep = exponents[:, 2], exponents[:, 4]
    degrees = np.full((along.max(initial=0) + 1, deep.max(initial=0) + 1), -1, dtype=np.int32)
    np.maximum.at(degrees, (along, deep), exponents[:, 0] + exponents[:, 1])
    degrees = degrees[::-1]
    order = [
        (a, b, len(degrees) - 1 - c, e)
        for c, row in enumerate(degrees.tolist())
        for e, degree in enumerate(row)
        for b in range(degree + 1)
        for a in range(degree - b + 1)
    ]
    place = {term: number for number, term in enumerate(order)}
    weights = np.zeros((len(v), len(order), 3))
    for (a, b, c, d, e), levels in zip(exponents.tolist(), coefficients, strict=True):
        weights[:, place[a, b, c, e]] += (v.astype(np.float64) ** d)[:, None] * levels
    return degrees, weights.astype(np.float32)


MOST_LAMPS = 6
_PLACES = 3  # 1, u and v


@dataclass(frozen=True, slots=True, kw_only=True)
class NearLamp:
    """A lamp beside the gel."""

    azimuth_rad: float  # where it stands, from growing columns towards growing rows [rad]
    elevation_rad: float  # angle of its light to the gel in the middle of the image [rad]
    distance: float  # from the middle of the image, in halves of its width

    def seen_from(self, position: RealArray, *, softness: float) -> RealArray:
        """Return the direction to the lamp, of length 1, and its light on level gel, shape [4, n].

        Positions are in halves of the image's width along both.
        """
        along = self.distance * math.cos(self.azimuth_rad) - position[0]
        across = self.distance * math.sin(self.azimuth_rad) - position[1]
        height = self.distance * math.tan(self.elevation_rad)
        away = np.sqrt(along * along + across * across + height * height)
        level = np.asarray(height / away)
        return np.stack([along / away, across / away, level, softened(level, softness)])


@dataclass(frozen=True, slots=True, kw_only=True)
class ShadingTerms:
    """Lamps and creases; each contributes its value, and that times u and times v."""

    lamps: tuple[NearLamp, ...]
    softness: float  # half width of their terminators, as a cosine
    aspect: float  # height of the image over its width
    crease_limit: float  # largest curvature [1/m]; sharper creases change no more

    @property
    def count(self) -> int:
        """Number of terms."""
        return _PLACES * (len(self.lamps) + 1)

    def values(self, tilt: RealArray, position: RealArray, curvature: RealArray) -> RealArray:
        """Return the terms at normalised pixels, [count, n]; curvature is div(tilt) [1/m]."""
        upright = np.sqrt(np.maximum(1.0 - tilt[0] ** 2 - tilt[1] ** 2, 0.0))
        place = np.stack([position[0], position[1] * self.aspect])
        basic = []
        for lamp in self.lamps:  # the light on the surface less that on a level one
            along, across, height, level = lamp.seen_from(place, softness=self.softness)
            cosine = np.asarray(height * upright + tilt[0] * along + tilt[1] * across)
            basic.append(np.asarray(softened(cosine, self.softness) - level))
        bounded = np.clip(curvature, -self.crease_limit, self.crease_limit)
        basic.append(bounded * CREASE_UNIT_M)
        terms = np.empty((len(basic), _PLACES, len(upright)), dtype=tilt.dtype)
        for row, value in zip(terms, basic, strict=True):
            row[0] = value
            np.multiply(value, position, out=row[1:])
        return terms.reshape(self.count, -1)


def softened(cosine: RealArray, softness: float) -> RealArray:
    """Return the cosine where it is positive, and zero where not, with a soft bend between."""
    return np.asarray(0.5 * (cosine + np.sqrt(cosine * cosine + softness * softness)))


def lamp_planes(terms: ShadingTerms | None, position: RealArray, layout: PixelBlocks) -> Any:
    """Return each lamp's direction and light on level gel in blocks, shape [4 lamp_count rows]."""
    if terms is None or not terms.lamps:
        return layout.array(np.zeros((0, layout.lanes)), layout.block)
    place = np.stack([position[0], position[1] * np.float32(terms.aspect)])
    lamps = [lamp.seen_from(place, softness=terms.softness) for lamp in terms.lamps]
    return layout.pixel_rows(np.concatenate(lamps).reshape(1, -1, layout.geometry.width))[0]


def lamp_weights(
    terms: ShadingTerms | None, term_coefficients: FloatArray, v: RealArray
) -> Float32Array:
    """Return level and slope of lamps' and creases' colours along rows, [row, lamp + 1, 3, 2]."""
    if terms is None:
        return np.zeros((len(v), 1, 3, 2), dtype=np.float32)
    level, along, across = term_coefficients.reshape(-1, 3, 3).transpose(1, 0, 2)
    levels = level + v[:, None, None] * across
    return np.stack([levels, np.broadcast_to(along, levels.shape)], axis=-1).astype(np.float32)


@dataclass(frozen=True, slots=True, kw_only=True)
class PhotometricModel:
    """Polynomial in tilt (p, q), normalised pixel position (u, v) and indentation w [mm].

    colour change = sum_k coefficient_k p^a_k q^b_k u^c_k v^d_k w^e_k, with a + b + e >= 1.
    It is a change of light, in grey levels below the camera's knee; see ``Response``.
    """

    exponents: IntArray  # a, b, c, d, e of each term, shape [term_count, 5]
    coefficients: FloatArray  # grey levels of red, green, blue for each term, shape [term_count, 3]
    tilt_limit: float = 1.0  # that the coefficients hold for; steeper surfaces are drawn so steep
    indentation_limit_m: float = math.inf  # largest that the coefficients were fitted to [m]
    terms: ShadingTerms | None = None  # lamps and creases, not bounded by the limit of tilt
    # Grey levels of red, green, blue for each of them, shape [count, 3]
    term_coefficients: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    response: Response = LINEAR
    # Grey level of a no-contact frame to which the change holds; over other levels it is in
    # proportion, as paint and lamps shade both alike. None adds the same everywhere.
    reference: float | None = None
    # Where the coefficients come from, as JSON values with units in the keys
    provenance: Mapping[str, Any] = field(default_factory=dict)

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
        steepness = np.sqrt(tilt[0] * tilt[0] + tilt[1] * tilt[1])
        bounded = np.asarray(tilt * (self.tilt_limit / np.maximum(steepness, self.tilt_limit)))
        at = bounded, position, np.minimum(indentation_m, self.indentation_limit_m)
        # Terms that differ in place only share the rest.
        (shapes, shape_of), (places, place_of) = shapes_and_places(self.exponents)
        weights = np.zeros((len(places), 3, len(shapes)), dtype=bounded.dtype)
        weights[place_of, :, shape_of] = self.coefficients
        by_place = weights.reshape(-1, len(shapes)) @ monomials(*at, shapes)
        by_place = by_place.reshape(len(places), 3, -1)
        change = np.asarray(np.einsum("kn,kcn->cn", monomials(*at, places), by_place))
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
        from sim.optics.colour.colour_kernel import colour_pixels  # noqa: PLC0415 - Warp

        light = np.asarray(self.response.light(frame), dtype=np.float32)
        height, width = layout.geometry.height, layout.geometry.width
        position, gain = normalised_positions(height, width), self.gain(light)
        inputs = [
            self._colours(position[1, ::width], layout),
            layout.pixel_rows(position[:1, :width])[0],
            lamp_planes(self.terms, position, layout),
            layout.pixel_rows(gain),
        ]
        return PixelColours(
            light=light, response=self.response, gain=gain, kernel=colour_pixels, inputs=inputs
        )

    def _colours(self, v: Float32Array, layout: PixelBlocks) -> Any:
        import warp as wp  # noqa: PLC0415 - Warp

        from sim.device import filled  # noqa: PLC0415 - Warp
        from sim.optics.colour.colour_kernel import Colours  # noqa: PLC0415 - Warp

        terms = self.terms
        degrees, weights = row_weights(self.exponents, self.coefficients, v)
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
        wrong = f"{path} is not an optics calibration ({error})"
        raise ConfigError(wrong, remedy=remedy) from error


def normalised_positions(height: int, width: int) -> Float32Array:
    """Return u, v over columns and rows, -1 and 1 in first and last, shape [2, height * width]."""
    v, u = np.meshgrid(np.linspace(-1, 1, height), np.linspace(-1, 1, width), indexing="ij")
    return np.stack([u.ravel(), v.ravel()]).astype(np.float32)
