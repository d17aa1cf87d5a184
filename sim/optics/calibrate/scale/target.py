"""Flat targets, written as text, and their points in an image.

ChArUco boards, ArUco grids and grids of dots: ``charuco:columns=8,rows=6,square=2mm,marker=1.5mm``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from sim.arrays import FloatArray
from sim.optics.calibrate.scale.dot_grid import find_dots
from tacauchy_rig.errors import ConfigError
from tacauchy_rig.quantities import Dimension, parse_quantity

GreyArray = NDArray[np.uint8]
_ENLARGE = 3
_SMALLEST_IMAGE_PX = 1200
_EXAMPLES = {
    "charuco": "charuco:columns=8,rows=6,square=2mm,marker=1.5mm,dictionary=4X4_50",
    "aruco": "aruco:columns=5,rows=4,marker=2mm,gap=0.5mm,dictionary=4X4_50",
    "dots": "dots:columns=7,rows=5,pitch=2mm",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetPoints:
    """Points of a target that an image shows.

    Attributes:
        positions_m: From the target's middle, x along its rows, y down its columns [m], [n, 2].
        pixels: Column and row [px], shape [n, 2].
        wanted: How many points the target has.
    """

    positions_m: FloatArray
    pixels: FloatArray
    wanted: int


class ScaleTarget(Protocol):
    """A flat target of known size."""

    def find(self, image: GreyArray) -> TargetPoints:
        """Return the points that a grey image shows; none where it shows no target."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class CharucoTarget:
    """Chessboard with ArUco markers in its white squares."""

    columns: int
    rows: int
    square_m: float
    marker_m: float
    dictionary: str = "4X4_50"

    def board(self) -> cv2.aruco.CharucoBoard:
        """Return OpenCV's description of the board, in units of one square."""
        return cv2.aruco.CharucoBoard(
            (self.columns, self.rows),
            1.0,
            self.marker_m / self.square_m,
            _dictionary(self.dictionary),
        )

    def find(self, image: GreyArray) -> TargetPoints:
        """Return the inner corners of the chessboard."""
        board = self.board()
        large, factor = _enlarged(image)
        corners, found, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(large)
        wanted = (self.columns - 1) * (self.rows - 1)
        return _matched(board, corners, found, factor, unit_m=self.square_m, wanted=wanted)


@dataclass(frozen=True, slots=True, kw_only=True)
class ArucoTarget:
    """Grid of ArUco markers, numbered along the rows."""

    columns: int
    rows: int
    marker_m: float
    gap_m: float
    dictionary: str = "4X4_50"

    def board(self) -> cv2.aruco.GridBoard:
        """Return OpenCV's description of the grid, in units of one marker."""
        return cv2.aruco.GridBoard(
            (self.columns, self.rows), 1.0, self.gap_m / self.marker_m, _dictionary(self.dictionary)
        )

    def find(self, image: GreyArray) -> TargetPoints:
        """Return the four corners of every marker."""
        board = self.board()
        large, factor = _enlarged(image)
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        detector = cv2.aruco.ArucoDetector(_dictionary(self.dictionary), parameters)
        corners, found, _ = detector.detectMarkers(large)
        wanted = 4 * self.columns * self.rows
        return _matched(board, corners, found, factor, unit_m=self.marker_m, wanted=wanted)


@dataclass(frozen=True, slots=True, kw_only=True)
class DotTarget:
    """Regular grid of dots; which way round it lies is taken to be the nearest to the image's."""

    columns: int
    rows: int
    pitch_m: float

    def find(self, image: GreyArray) -> TargetPoints:
        """Return the centres of all dots, or none."""
        wanted = self.columns * self.rows
        pixels = find_dots(image, columns=self.columns, rows=self.rows)
        if pixels is None:
            return _nothing(wanted)
        j, i = np.mgrid[: self.rows, : self.columns].astype(np.float64)
        places = np.stack([i.ravel(), j.ravel()], axis=1)
        middle = 0.5 * (np.array([self.columns, self.rows]) - 1.0)
        return TargetPoints(
            positions_m=(places - middle) * self.pitch_m, pixels=pixels, wanted=wanted
        )


def find_target(target: ScaleTarget, image: GreyArray, *, name: str) -> TargetPoints:
    """Find a target as it is, or mirrored, as a camera sees it through a mirror.

    Args:
        target: What to look for.
        image: Grey, uint8, shape [height, width].
        name: Of the image, for messages.

    Raises:
        ConfigError: Less than half of the target is found.
    """
    found = target.find(image)
    if not isinstance(target, DotTarget):
        mirrored = target.find(np.ascontiguousarray(image[:, ::-1]))
        if len(mirrored.pixels) > len(found.pixels):
            flipped = (image.shape[1] - 1.0, 0.0) + mirrored.pixels * (-1.0, 1.0)
            found = TargetPoints(
                positions_m=mirrored.positions_m, pixels=flipped, wanted=mirrored.wanted
            )
    if 2 * len(found.pixels) < found.wanted:
        raise ConfigError(
            f"{name} shows {len(found.pixels)} of the target's {found.wanted} points",
            remedy="check --target against the print (columns, rows, dictionary), and that the "
            "target lies flat, whole in the image and in focus",
        )
    return found


def _dictionary(name: str) -> cv2.aruco.Dictionary:
    number = getattr(cv2.aruco, f"DICT_{name.upper()}", None)
    if number is None:
        raise ConfigError(
            f"no ArUco dictionary {name!r}", remedy="for example 4X4_50, 5X5_100 or 6X6_250"
        )
    return cv2.aruco.getPredefinedDictionary(number)


def _enlarged(image: GreyArray) -> tuple[GreyArray, int]:
    """Enlarge small images: the detectors want markers of more pixels than a 320 x 240 gives."""
    factor = _ENLARGE if max(image.shape) < _SMALLEST_IMAGE_PX else 1
    size = (image.shape[1] * factor, image.shape[0] * factor)
    enlarged = cv2.resize(image, size, interpolation=cv2.INTER_CUBIC)
    return np.asarray(enlarged, dtype=np.uint8), factor


def _matched(
    board: cv2.aruco.Board, corners: Any, found: Any, factor: int, *, unit_m: float, wanted: int
) -> TargetPoints:
    """Return the points of a board that a detector found in an enlarged image.

    Args:
        board: In its own units.
        corners: As the detector gives them.
        found: Their numbers on the board; None is no corner.
        factor: By which the image was enlarged.
        unit_m: Of the board [m].
        wanted: How many points the board has.
    """
    known, pixels = (None, None) if found is None else board.matchImagePoints(corners, found)
    if known is None or pixels is None:
        return _nothing(wanted)
    middle = 0.5 * np.array(board.getRightBottomCorner()[:2])
    return TargetPoints(
        positions_m=(known.reshape(-1, 3)[:, :2].astype(np.float64) - middle) * unit_m,
        pixels=(pixels.reshape(-1, 2).astype(np.float64) + 0.5) / factor - 0.5,
        wanted=wanted,
    )


def _nothing(wanted: int) -> TargetPoints:
    return TargetPoints(positions_m=np.empty((0, 2)), pixels=np.empty((0, 2)), wanted=wanted)


_KINDS: dict[str, tuple[Callable[..., ScaleTarget], tuple[str, ...]]] = {
    "charuco": (CharucoTarget, ("square", "marker")),
    "aruco": (ArucoTarget, ("marker", "gap")),
    "dots": (DotTarget, ("pitch",)),
}


def parse_target(text: str) -> ScaleTarget:
    """Read a target.

    Raises:
        ConfigError: No such target, or a number that is missing, unknown or without its unit.
    """
    kind, _, terms = text.partition(":")
    if kind not in _KINDS:
        raise ConfigError(
            f"--target {text!r}: no such target", remedy=f"write {', '.join(_EXAMPLES.values())}"
        )
    made, lengths = _KINDS[kind]
    given = dict(part.partition("=")[::2] for part in terms.split(",") if part)
    needed = {"columns", "rows", *lengths}
    optional = set() if kind == "dots" else {"dictionary"}
    wrong = sorted((needed - set(given)) | (set(given) - needed - optional))
    if wrong:
        raise ConfigError(
            f"--target {kind}: missing or unknown: {', '.join(wrong)}",
            remedy=f"write {_EXAMPLES[kind]}",
        )
    counts = {key: _count(given[key], f"--target {key}") for key in ("columns", "rows")}
    sizes = {f"{key}_m": _length(given[key], f"--target {key}") for key in lengths}
    if kind == "charuco" and not sizes["marker_m"] < sizes["square_m"]:
        raise ConfigError(
            f"--target charuco: marker {given['marker']} is not smaller than square "
            f"{given['square']}",
            remedy="give both as printed",
        )
    return made(**counts, **sizes, **{key: given[key] for key in optional & set(given)})


def _count(text: str, field: str) -> int:
    if not text.isdigit() or int(text) < 2:
        raise ConfigError(f"{field} {text!r} is not a whole number above 1", remedy="count again")
    return int(text)


def _length(text: str, field: str) -> float:
    value = parse_quantity(text, dimension=Dimension.LENGTH, field=field)
    if not value > 0.0:
        raise ConfigError(f"{field} {text!r} is not positive", remedy="measure the print")
    return value
