"""Where pixels look, from points at known places: presses of the robot, or a printed target.

Targets are flat: ChArUco boards, ArUco grids and grids of dots, written as text such as
``charuco:columns=8,rows=6,square=2mm,marker=1.5mm``.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from inspect import signature
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


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetPoints:
    """Points of a target that an image shows."""

    positions_m: FloatArray  # from its middle, x along rows, y down columns [m], [n, 2]
    pixels: FloatArray  # column and row [px], shape [n, 2]
    wanted: int


@dataclass(frozen=True, slots=True)
class BoardTarget:
    """A board of ArUco markers, whose points OpenCV detects and knows by their numbers."""

    board: Any  # OpenCV's description, in metres
    detect: Callable[[Any], Sequence[Any]]  # from a grey image to corners and their numbers
    wanted: int  # points

    def find(self, image: ImageArray) -> TargetPoints:
        """Return the points that a grey image shows, as it is or mirrored."""
        found, mirrored = self._found(image), self._found(np.ascontiguousarray(image[:, ::-1]))
        if len(mirrored.pixels) <= len(found.pixels):
            return found
        flipped = (image.shape[1] - 1.0, 0.0) + mirrored.pixels * (-1.0, 1.0)
        return replace(mirrored, pixels=flipped)

    def _found(self, image: ImageArray) -> TargetPoints:
        # The detectors want markers of more pixels than a 320 x 240 image gives.
        factor = _ENLARGE if max(image.shape) < _SMALLEST_IMAGE_PX else 1
        large = cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_CUBIC)
        corners, numbers, *_ = self.detect(large)
        match = self.board.matchImagePoints
        known, pixels = (None, None) if numbers is None else match(corners, numbers)
        if known is None or pixels is None:
            known, pixels = np.empty((0, 3)), np.empty((0, 2))
        middle = 0.5 * np.array(self.board.getRightBottomCorner()[:2])
        return TargetPoints(
            positions_m=known.reshape(-1, 3)[:, :2].astype(np.float64) - middle,
            pixels=(pixels.reshape(-1, 2).astype(np.float64) + 0.5) / factor - 0.5,
            wanted=self.wanted,
        )


def _charuco(
    *, columns: int, rows: int, square: float, marker: float, dictionary: str = "4X4_50"
) -> BoardTarget:
    """Chessboard with ArUco markers in its white squares; its inner corners are found."""
    if not marker < square:
        raise ConfigError(
            f"--target charuco: marker {marker * 1e3:g} mm is not smaller than square "
            f"{square * 1e3:g} mm",
            remedy="give both as printed",
        )
    board = cv2.aruco.CharucoBoard((columns, rows), square, marker, _markers(dictionary))
    detect = cv2.aruco.CharucoDetector(board).detectBoard
    return BoardTarget(board, detect, (columns - 1) * (rows - 1))


def _aruco(
    *, columns: int, rows: int, marker: float, gap: float, dictionary: str = "4X4_50"
) -> BoardTarget:
    """Grid of ArUco markers, numbered along the rows; the corners of every marker are found."""
    parameters, markers = cv2.aruco.DetectorParameters(), _markers(dictionary)
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detect = cv2.aruco.ArucoDetector(markers, parameters).detectMarkers
    board = cv2.aruco.GridBoard((columns, rows), marker, gap, markers)
    return BoardTarget(board, detect, 4 * columns * rows)


def _markers(dictionary: str) -> cv2.aruco.Dictionary:
    number = getattr(cv2.aruco, f"DICT_{dictionary.upper()}", None)
    if number is None:
        raise ConfigError(
            f"no ArUco dictionary {dictionary!r}", remedy="for example 4X4_50, 5X5_100 or 6X6_250"
        )
    return cv2.aruco.getPredefinedDictionary(number)


@dataclass(frozen=True, slots=True, kw_only=True)
class DotTarget:
    """Regular grid of dots; which way round it lies is taken to be the nearest to the image's."""

    columns: int
    rows: int
    pitch: float  # [m]

    def find(self, image: ImageArray) -> TargetPoints:
        """Return the centres of all dots, dark or bright, or none."""
        smooth = np.asarray(cv2.GaussianBlur(image, (0, 0), _SMOOTHING_PX), dtype=np.uint8)
        pixels = self._grid(smooth)
        if len(pixels) == 0:
            pixels = self._grid(255 - smooth)
        j, i = np.mgrid[: self.rows, : self.columns].astype(np.float64)
        places = np.stack([i.ravel(), j.ravel()], axis=1) * self.pitch
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


ScaleTarget = BoardTarget | DotTarget
_KINDS: dict[str, tuple[Callable[..., ScaleTarget], str]] = {
    "charuco": (_charuco, "columns=8,rows=6,square=2mm,marker=1.5mm,dictionary=4X4_50"),
    "aruco": (_aruco, "columns=5,rows=4,marker=2mm,gap=0.5mm,dictionary=4X4_50"),
    "dots": (DotTarget, "columns=7,rows=5,pitch=2mm"),
}


def find_target(target: ScaleTarget, image: ImageArray, *, name: str) -> TargetPoints:
    """Find a target in a grey image.

    Raises:
        ConfigError: Less than half of the target is found.
    """
    found = target.find(image)
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
        examples = ", ".join(f"{name}:{example}" for name, (_, example) in _KINDS.items())
        raise ConfigError(f"--target {text!r}: no such target", remedy=f"write {examples}")
    make, example = _KINDS[kind]
    given = dict(part.partition("=")[::2] for part in terms.split(",") if part)
    known = signature(make).parameters.keys()
    wrong = sorted((known - given.keys() - {"dictionary"}) | (given.keys() - known))
    if wrong:
        raise ConfigError(
            f"--target {kind}: missing or unknown: {', '.join(wrong)}",
            remedy=f"write {kind}:{example}",
        )
    return make(**{key: _value(key, text) for key, text in given.items()})


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
    shear_rad: float  # of the pixels' axes from a right angle; the geometry cannot express it
    scale_error_m: tuple[float, float]  # standard error in x and y, from the residuals [m/px]
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
        width, height: Of the image [px].

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
    off = geometry.to_pixels(positions_m) - pixels
    spread = np.sqrt(np.sum((features @ solution - positions_m) ** 2) / (2 * len(pixels) - 6))
    errors = spread * np.sqrt(np.diag(np.linalg.inv(features.T @ features)))
    middle = float(np.hypot(*(centre - pixels.mean(axis=0))))
    at_centre = math.hypot(spread / math.sqrt(len(pixels)), float(errors[:2].max()) * middle)
    return ScaleFit(
        geometry=geometry,
        residual_px=float(np.sqrt(np.mean(np.sum(off**2, axis=1)))),
        shear_rad=float(shear),
        scale_error_m=(float(errors[0]), float(errors[1])),
        rotation_error_rad=float(np.max(errors[:2] / scale)),
        centre_error_px=at_centre / geometry.mean_scale_m,
    )
