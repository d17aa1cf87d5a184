"""A set of ball presses on the emulated sensor, as a lab takes them to calibrate its optics.

Writes the images (border cropped, at the size that is scored), the no-contact frame, a table of
circles "as clicked by a person" (the true contact circle, off by a pixel or so), and where the
robot was told to press; the true place differs by the emulated world's pose error.
"""

from __future__ import annotations

import csv
import math
from pathlib import Path

import cv2
import numpy as np

from drivers.emulators.plant.arrays import ImageArray
from drivers.emulators.plant.press_table import case_for, press_table
from drivers.emulators.plant.still import gel_view, render_press
from drivers.emulators.plant.tips import SphereTip
from drivers.emulators.plant.truth import PlantTruth
from drivers.emulators.plant.unit import EmulatedUnit

BALL_DIAMETER_M = 4.7e-3
CLICK_ERROR_PX = 1.0
NO_CONTACT = "no_contact.png"
CIRCLES = "circles.csv"
POSITIONS = "positions.csv"
_RAW_SIZE = (640, 480)
_JPEG_QUALITY = 94  # of the emulated camera's stream
_DEPTHS_M = (0.25e-3, 1.2e-3)
_DEEPEST_SHARE = 0.3  # of the gel's thickness
_REACH = (0.64, 0.55)  # of half the image


def write_ball_presses(truth: PlantTruth, folder: Path, *, count: int = 40) -> None:
    """Press a 4.70 mm ball ``count`` times at scattered places and depths and keep the images.

    Args:
        truth: The emulated world, with the optics that the calibration has to find.
        folder: Receives ``press-01.png`` ..., ``no_contact.png``, ``circles.csv`` and
            ``positions.csv``.
        count: Number of presses.
    """
    folder.mkdir(parents=True, exist_ok=True)
    tip = SphereTip(diameter_m=BALL_DIAMETER_M)
    table = press_table(case_for(tip, truth.poisson, gel=truth.unit.gel))
    view = gel_view(truth, _RAW_SIZE)
    hand = np.random.default_rng([truth.seed, 4])
    cv2.imwrite(str(folder / NO_CONTACT), _averaged(truth, tip))
    circles, positions = [], []
    for number, (x, y, depth) in enumerate(_places(count, truth.unit), start=1):
        axis = (x + truth.pose_error_m[0], y + truth.pose_error_m[1])
        place, lean = _touched(axis, truth.unit)
        raw = render_press(
            truth, tip, depth, _RAW_SIZE, centre_m=place, lean_rad=lean, noise_seed=number
        )
        name = f"press-{number:02d}.png"
        cv2.imwrite(str(folder / name), _scored(_sent(raw), truth.unit))
        radius = float(np.interp(depth, table.depths, table.contact_radius))
        column, row = _scored_pixel(view.pixel(*place), truth.unit)
        clicked = np.array([column, row, radius / view.m_per_px[0] * _ratio(truth.unit)[0]])
        clicked += CLICK_ERROR_PX * hand.standard_normal(3)
        circles.append([name, *(f"{value:.2f}" for value in clicked)])
        positions.append([name, f"{x:.7f}", f"{y:.7f}"])
    _write(folder / CIRCLES, ["image", "center_x_px", "center_y_px", "radius_px"], circles)
    _write(folder / POSITIONS, ["image", "x_m", "y_m"], positions)


def _write(path: Path, header: list[str], rows: list[list[str]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        writer.writerows(rows)


def _places(count: int, unit: EmulatedUnit) -> list[tuple[float, float, float]]:
    """Return x, y and depth [m] of each press, filling the image evenly (R2 sequence)."""
    plastic = 1.324717957244746
    deepest_m = min(_DEPTHS_M[1], _DEEPEST_SHARE * unit.gel.thickness_m)
    reach_x, reach_y = (
        share * 0.5 * size * pixel
        for share, size, pixel in zip(_REACH, unit.image_size, unit.pixel_m, strict=True)
    )
    found = []
    for k in range(1, count + 1):
        u, v, w = k / plastic % 1.0, k / plastic**2 % 1.0, k * math.sqrt(0.5) % 1.0
        depth = _DEPTHS_M[0] + w * (deepest_m - _DEPTHS_M[0])
        found.append(((2 * u - 1) * reach_x, (2 * v - 1) * reach_y, depth))
    return found


def _touched(
    axis: tuple[float, float], unit: EmulatedUnit
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return where a ball on a domed gel touches [m], and how the contact leans there [rad].

    Ball and gel have one slope where they touch, beside the ball's axis and nearer to the gel's
    highest point; a ball itself cannot lean.
    """
    bend_x, bend_y = unit.dome_curvatures
    radius = 0.5 * BALL_DIAMETER_M
    place = (axis[0] / (1.0 + radius * bend_x), axis[1] / (1.0 + radius * bend_y))
    return place, (place[0] * bend_x, place[1] * bend_y)


def _averaged(truth: PlantTruth, tip: SphereTip, *, frames: int = 12) -> ImageArray:
    """Return the no-contact frame averaged over its noise, as a lab averages it."""
    stack = [
        _sent(render_press(truth, tip, 0.0, _RAW_SIZE, noise_seed=1000 + k)).astype(np.float32)
        for k in range(frames)
    ]
    return _scored(np.rint(np.mean(stack, axis=0)).astype(np.uint8), truth.unit)


def _sent(raw: ImageArray) -> ImageArray:
    """Return what is left of a raw frame after the camera's JPEG."""
    _, data = cv2.imencode(".jpg", raw, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8)


def _scored(raw: ImageArray, unit: EmulatedUnit) -> ImageArray:
    left, top = _border(unit)
    cropped = raw[top : raw.shape[0] - top, left : raw.shape[1] - left]
    scaled = cv2.resize(
        np.ascontiguousarray(cropped), unit.image_size, interpolation=cv2.INTER_AREA
    )
    return np.asarray(scaled, dtype=np.uint8)


def _border(unit: EmulatedUnit) -> tuple[int, int]:
    return math.floor(_RAW_SIZE[0] * unit.crop), math.floor(_RAW_SIZE[1] * unit.crop)


def _ratio(unit: EmulatedUnit) -> tuple[float, float]:
    (left, top), (columns, rows) = _border(unit), unit.image_size
    return columns / (_RAW_SIZE[0] - 2 * left), rows / (_RAW_SIZE[1] - 2 * top)


def _scored_pixel(raw: tuple[float, float], unit: EmulatedUnit) -> tuple[float, float]:
    column, row = (
        (place + 0.5 - border) * ratio - 0.5
        for place, border, ratio in zip(raw, _border(unit), _ratio(unit), strict=True)
    )
    return column, row
