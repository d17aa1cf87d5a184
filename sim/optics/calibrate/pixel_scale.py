"""Where pixels look, from points at known places: presses of the robot, or a printed target.

Targets are flat: ChArUco boards, ArUco grids and grids of dots, written as text such as
``charuco:columns=8,rows=6,square=2mm,marker=1.5mm``.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial import cKDTree

from sim.optics.calibrate.ball_press import read_image_table
from sim.sensor.camera_geometry import CameraGeometry
from tacauchy_rig.core.arrays import FloatArray, ImageArray
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.quantities import Dimension, parse_quantity

_ENLARGE = 3
_SMALLEST_IMAGE_PX = 1200
# Noise is smoothed away before dots are looked for, by thresholds [grey levels]: between, a step.
_SMOOTHING_PX, _LEVELS, _LEVEL_STEP = 1.0, (5, 250), 3
_SMALLEST_DOT_PX = 2.5  # its side
# A dot of this share of the grid's dots' size, and so many of its steps off, would be of the grid.
_LEAST_SIZE, _NEIGHBOUR = 0.7, (0.7, 1.3)
_FEWEST, _APART_M = 4, 1e-4  # points that fix a scale, and how far from one line they lie
_EXAMPLES = {
    "charuco": "charuco:columns=8,rows=6,square=2mm,marker=1.5mm,dictionary=4X4_50",
    "aruco": "aruco:columns=5,rows=4,marker=2mm,gap=0.5mm,dictionary=4X4_50",
    "dots": "dots:columns=7,rows=5,pitch=2mm",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetPoints:
    """Points of a target that an image shows."""

    # From the target's middle, x along its rows, y down its columns [m], [n, 2]
    positions_m: FloatArray
    pixels: FloatArray  # column and row [px], shape [n, 2]
    wanted: int


@dataclass(frozen=True, slots=True, kw_only=True)
class _BoardTarget:
    """A board of ArUco markers, whose points OpenCV detects and knows by their numbers."""

    columns: int
    rows: int
    dictionary: str = "4X4_50"

    def _markers(self) -> cv2.aruco.Dictionary:
        number = getattr(cv2.aruco, f"DICT_{self.dictionary.upper()}", None)
        if number is None:
            raise ConfigError(
                f"no ArUco dictionary {self.dictionary!r}",
                remedy="for example 4X4_50, 5X5_100 or 6X6_250",
            )
        return cv2.aruco.getPredefinedDictionary(number)

    def _found(
        self, board: Any, detect: Callable[[Any], Sequence[Any]], image: ImageArray, wanted: int
    ) -> TargetPoints:
        # The detectors want markers of more pixels than a 320 x 240 image gives.
        factor = _ENLARGE if max(image.shape) < _SMALLEST_IMAGE_PX else 1
        large = cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_CUBIC)
        corners, found, *_ = detect(large)
        known, pixels = (None, None) if found is None else board.matchImagePoints(corners, found)
        if known is None or pixels is None:
            known, pixels = np.empty((0, 3)), np.empty((0, 2))
        middle = 0.5 * np.array(board.getRightBottomCorner()[:2])
        return TargetPoints(
            positions_m=known.reshape(-1, 3)[:, :2].astype(np.float64) - middle,
            pixels=(pixels.reshape(-1, 2).astype(np.float64) + 0.5) / factor - 0.5,
            wanted=wanted,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class CharucoTarget(_BoardTarget):
    """Chessboard with ArUco markers in its white squares; its inner corners are found."""

    square_m: float
    marker_m: float

    def __post_init__(self) -> None:
        if not self.marker_m < self.square_m:
            raise ConfigError(
                f"--target charuco: marker {self.marker_m * 1e3:g} mm is not smaller than square "
                f"{self.square_m * 1e3:g} mm",
                remedy="give both as printed",
            )

    def board(self) -> cv2.aruco.CharucoBoard:
        """Return OpenCV's description of the board, in metres."""
        size = (self.columns, self.rows)
        return cv2.aruco.CharucoBoard(size, self.square_m, self.marker_m, self._markers())

    def find(self, image: ImageArray) -> TargetPoints:
        """Return the inner corners that a grey image shows; none where it shows no target."""
        detect = cv2.aruco.CharucoDetector(board := self.board()).detectBoard
        return self._found(board, detect, image, (self.columns - 1) * (self.rows - 1))


@dataclass(frozen=True, slots=True, kw_only=True)
class ArucoTarget(_BoardTarget):
    """Grid of ArUco markers, numbered along the rows; the corners of every marker are found."""

    marker_m: float
    gap_m: float

    def board(self) -> cv2.aruco.GridBoard:
        """Return OpenCV's description of the grid, in metres."""
        size = (self.columns, self.rows)
        return cv2.aruco.GridBoard(size, self.marker_m, self.gap_m, self._markers())

    def find(self, image: ImageArray) -> TargetPoints:
        """Return the markers' corners that a grey image shows; none where it shows no target."""
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        board = self.board()
        detect = cv2.aruco.ArucoDetector(board.getDictionary(), parameters).detectMarkers
        return self._found(board, detect, image, 4 * self.columns * self.rows)


@dataclass(frozen=True, slots=True, kw_only=True)
class DotTarget:
    """Regular grid of dots; which way round it lies is taken to be the nearest to the image's."""

    columns: int
    rows: int
    pitch_m: float

    def find(self, image: ImageArray) -> TargetPoints:
        """Return the centres of all dots, dark or bright, or none."""
        smooth = np.asarray(cv2.GaussianBlur(image, (0, 0), _SMOOTHING_PX), dtype=np.uint8)
        pixels = self._grid(smooth)
        if len(pixels) == 0:
            pixels = self._grid(255 - smooth)
        j, i = np.mgrid[: self.rows, : self.columns].astype(np.float64)
        places = np.stack([i.ravel(), j.ravel()], axis=1) * self.pitch_m
        known = (places - places.mean(axis=0))[: len(pixels)]
        return TargetPoints(positions_m=known, pixels=pixels, wanted=len(places))

    def _grid(self, image: ImageArray) -> FloatArray:
        """Return the centres of dark dots row by row [px]; none unless they are just this grid."""
        settings = cv2.SimpleBlobDetector.Params()
        settings.minArea = _SMALLEST_DOT_PX**2
        settings.maxArea = image.size / (self.columns * self.rows)
        settings.minDistBetweenBlobs = _SMALLEST_DOT_PX
        settings.minThreshold, settings.maxThreshold = _LEVELS
        settings.thresholdStep = _LEVEL_STEP
        detector = cv2.SimpleBlobDetector.create(settings)
        size = (self.columns, self.rows)
        seen, centres = cv2.findCirclesGrid(image, size, blobDetector=detector)
        if not seen or centres is None:
            return np.empty((0, 2))
        grid = centres.reshape(self.rows, self.columns, 2).astype(np.float64)
        along, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
        if self.rows == self.columns and abs(along[0]) < abs(down[0]):
            grid, along, down = grid.swapaxes(0, 1), down, along
        grid = grid[:: 1 if down[1] > 0.0 else -1, :: 1 if along[0] > 0.0 else -1]
        pixels = grid.reshape(-1, 2)
        # A dot as large as these, about a step beside one of them, is of a larger grid.
        dots = detector.detect(image)
        places, sizes = np.array([dot.pt for dot in dots]), np.array([dot.size for dot in dots])
        large = sizes > _LEAST_SIZE * np.median(sizes[cKDTree(places).query(pixels)[1]])
        away = cKDTree(pixels).query(places)[0] / np.linalg.norm(along) * (self.columns - 1)
        beside = large & (away > _NEIGHBOUR[0]) & (away < _NEIGHBOUR[1])
        return np.empty((0, 2)) if beside.any() else pixels


ScaleTarget = CharucoTarget | ArucoTarget | DotTarget
_KINDS: dict[str, type[ScaleTarget]] = {
    "charuco": CharucoTarget,
    "aruco": ArucoTarget,
    "dots": DotTarget,
}


def find_target(target: ScaleTarget, image: ImageArray, *, name: str) -> TargetPoints:
    """Find a target in a grey image as it is, or mirrored, as a camera sees it through a mirror.

    Raises:
        ConfigError: Less than half of the target is found.
    """
    found = target.find(image)
    if not isinstance(target, DotTarget):
        mirrored = target.find(np.ascontiguousarray(image[:, ::-1]))
        if len(mirrored.pixels) > len(found.pixels):
            flipped = (image.shape[1] - 1.0, 0.0) + mirrored.pixels * (-1.0, 1.0)
            found = replace(mirrored, pixels=flipped)
    if 2 * len(found.pixels) < found.wanted:
        raise ConfigError(
            f"{name} shows {len(found.pixels)} of the target's {found.wanted} points",
            remedy="check --target against the print (columns, rows, dictionary), and that the "
            "target lies flat, whole in the image and in focus",
        )
    return found


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
    given = dict(part.partition("=")[::2] for part in terms.split(",") if part)
    known = {field.name.removesuffix("_m"): field.name for field in fields(_KINDS[kind])}
    wrong = sorted((known.keys() - given.keys() - {"dictionary"}) | (given.keys() - known.keys()))
    if wrong:
        raise ConfigError(
            f"--target {kind}: missing or unknown: {', '.join(wrong)}",
            remedy=f"write {_EXAMPLES[kind]}",
        )
    return _KINDS[kind](**{known[key]: _value(key, text) for key, text in given.items()})


def _value(key: str, text: str) -> Any:
    if key == "dictionary":
        return text
    if key in ("columns", "rows"):
        if not text.isdigit() or int(text) < 2:
            raise ConfigError(
                f"--target {key} {text!r} is not a whole number above 1", remedy="count again"
            )
        return int(text)
    length_m = parse_quantity(text, dimension=Dimension.LENGTH, field=f"--target {key}")
    if not length_m > 0.0:
        raise ConfigError(f"--target {key} {text!r} is not positive", remedy="measure the print")
    return length_m


@dataclass(frozen=True, slots=True, kw_only=True)
class ScaleFit:
    """A camera's geometry and how well it fits."""

    geometry: CameraGeometry
    residual_px: float  # root mean square distance of the fitted from the labelled centres [px]
    # Departure of the pixel axes from a right angle that the geometry cannot express
    shear_rad: float
    # Standard error of the scales in x and y, from the residuals [m/px]
    scale_error_m: tuple[float, float]
    rotation_error_rad: float  # standard error of the rotation, from the residuals [rad]
    centre_error_px: float  # standard error of the centre, from the residuals [px]


def read_positions(path: Path) -> dict[str, tuple[float, float]]:
    """Read commanded positions, x and y from the gel's centre [m], by the names of images.

    Raises:
        ConfigError: The CSV with the columns image, x_m, y_m is missing, or a line without name or
            numbers; the message names the line.
    """
    lines = read_image_table(path, what="positions", numbers=("x_m", "y_m"))
    return {name: (x, y) for _, name, (x, y) in lines}


def fit_scale(positions_m: FloatArray, pixels: FloatArray, *, width: int, height: int) -> ScaleFit:
    """Fit mm per pixel in x and y, rotation, centre and mirroring.

    The pad's frame becomes the robot's, shifted to where the robot believes the gel's centre to be:
    that is the frame in which the presses of a run are commanded, so that a constant error between
    robot and sensor drops out.

    Args:
        positions_m: Commanded x, y of each press from the gel's centre, or of each point from the
            target's middle [m], shape [n, 2].
        pixels: Column, row of each contact's centre or point [px], shape [n, 2].
        width: Columns of the image [px].
        height: Rows of the image [px].

    Raises:
        ConfigError: Fewer than four presses, or all of them on one line.
    """
    if len(pixels) < _FEWEST:
        raise ConfigError(
            f"{len(pixels)} presses or points cannot fix scale, rotation and centre of a camera",
            remedy=f"press at {_FEWEST} or more places that are not on one line",
        )
    features = np.column_stack([pixels, np.ones(len(pixels))])
    if np.linalg.matrix_rank(features - [*features.mean(axis=0)[:2], 0.0], tol=1.0) < 3:
        raise ConfigError(
            "all presses lie on one line in the image", remedy="press also beside that line"
        )
    if np.linalg.matrix_rank(positions_m - positions_m.mean(axis=0), tol=_APART_M) < 2:
        raise ConfigError(
            "all places lie on one line on the gel",
            remedy="give the places of the presses in metres, and press also beside that line",
        )
    solution = np.asarray(np.linalg.lstsq(features, positions_m, rcond=None)[0], dtype=np.float64)
    direction, offset = solution[:2].T, solution[2]
    centre = np.linalg.solve(direction, -offset)
    scale = np.linalg.norm(direction, axis=0)
    angles = np.arctan2(direction[1], direction[0])
    mirrored = bool(np.linalg.det(direction) < 0.0)
    right_angle = -math.pi / 2 if mirrored else math.pi / 2
    shear = math.remainder(angles[1] - angles[0] - right_angle, 2 * math.pi)
    geometry = CameraGeometry(
        width=width,
        height=height,
        scale_x_m=float(scale[0]),
        scale_y_m=float(scale[1]),
        centre_x_px=float(centre[0]),
        centre_y_px=float(centre[1]),
        rotation_rad=float(angles[0] + 0.5 * shear),
        mirrored=mirrored,
    )
    return _with_errors(geometry, float(shear), features, solution, positions_m)


def _with_errors(
    geometry: CameraGeometry,
    shear_rad: float,
    features: FloatArray,
    solution: FloatArray,
    positions_m: FloatArray,
) -> ScaleFit:
    """State the standard errors of a fit of positions to features, pixels and a one, [n, 3]."""
    pixels = features[:, :2]
    centre = np.array([geometry.centre_x_px, geometry.centre_y_px])
    scale = np.array([geometry.scale_x_m, geometry.scale_y_m])
    off = geometry.to_pixels(positions_m) - pixels
    spread = np.sqrt(np.sum((features @ solution - positions_m) ** 2) / (2 * len(pixels) - 6))
    errors = spread * np.sqrt(np.diag(np.linalg.inv(features.T @ features)))
    middle = float(np.hypot(*(centre - pixels.mean(axis=0))))
    at_centre = math.hypot(spread / math.sqrt(len(pixels)), float(errors[:2].max()) * middle)
    return ScaleFit(
        geometry=geometry,
        residual_px=float(np.sqrt(np.mean(np.sum(off**2, axis=1)))),
        shear_rad=shear_rad,
        scale_error_m=(float(errors[0]), float(errors[1])),
        rotation_error_rad=float(np.max(errors[:2] / scale)),
        centre_error_px=at_centre / geometry.mean_scale_m,
    )
