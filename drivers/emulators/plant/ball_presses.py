"""A set of ball presses on the emulated sensor, as a lab takes them to calibrate its optics.

Writes the images (border cropped, at the size that is scored), the no-contact frame, a table of
circles "as clicked by a person" (the true contact circle, off by a pixel or so), and where the
robot was told to press; the true place differs by the emulated world's pose error.

Without noise the same presses tell what a calibration found: the emulator's own colours.
"""

import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from drivers.emulators.plant.gel_image_and_lights import render_press, view_of
from drivers.emulators.plant.press_table import case_for, press_table
from drivers.emulators.plant.truth import EmulatedUnit, PlantTruth, SphereTip
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.image_codec import decode_rgb, encode_jpeg

BALL_DIAMETER_M = 4.7e-3
CLICK_ERROR_PX = 1.0
NO_CONTACT = "no_contact.png"
CIRCLES = "circles.csv"
POSITIONS = "positions.csv"
_TIP = SphereTip(diameter_m=BALL_DIAMETER_M)
_RAW_SIZE = (640, 480)
_JPEG_QUALITY = 94  # of the emulated camera's stream
_DEPTHS_M = (0.25e-3, 1.2e-3)
_DEEPEST_SHARE = 0.4  # of the gel's thickness: less shows no slope as steep as beside a punch
_REACH = (0.64, 0.55)  # of half the image


@dataclass(frozen=True, slots=True)
class FrameNoise:
    """How far frames are from what a camera without noise would show, inside the contacts."""

    noise: float  # mean absolute difference that the sensor's noise makes [grey levels]
    recorded: float  # the same of noise and the stream's JPEG together [grey levels]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Press:
    """One press, or none: the gel without contact."""

    number: int = 0
    commanded_m: tuple[float, float] = (0.0, 0.0)
    depth_m: float = 0.0
    # Where the ball touched the gel [m]; ``tilt_rad`` is the contact's tilt there.
    touched_m: tuple[float, float] = (0.0, 0.0)
    tilt_rad: tuple[float, float] = (0.0, 0.0)
    # Column, row and radius of the contact in the image that is scored [px].
    circle_px: tuple[float, float, float] = (0.0, 0.0, 0.0)


def write_ball_presses(
    truth: PlantTruth, folder: Path, *, count: int = 40, first: int = 1, noise_free: bool = False
) -> None:
    """Press a 4.70 mm ball ``count`` times at scattered places and depths and keep the images.

    Args:
        folder: Receives ``press-01.png`` ..., ``no_contact.png``, ``circles.csv`` and
            ``positions.csv``.
        first: Number of the first press; presses of other numbers are at other places and depths.
        noise_free: Leave out the camera's noise and the JPEG of its stream.
    """
    camera = _Camera(truth)
    folder.mkdir(parents=True, exist_ok=True)
    clicks = np.random.default_rng([truth.seed, 4]).standard_normal((first - 1 + count, 3))
    unloaded = camera.scored(camera.raw(_Press())) if noise_free else camera.averaged()
    cv2.imwrite(str(folder / NO_CONTACT), unloaded)
    circles, positions = [], []
    for press, click in zip(camera.presses(count, first), clicks[first - 1 :], strict=True):
        name = f"press-{press.number:02d}.png"
        frame = camera.scored(camera.raw(press)) if noise_free else camera.recorded(press)
        cv2.imwrite(str(folder / name), frame)
        clicked = np.array(press.circle_px) + CLICK_ERROR_PX * click
        circles.append([name, *(f"{value:.2f}" for value in clicked)])
        positions.append([name, *(f"{value:.7f}" for value in press.commanded_m)])
    tables = {
        CIRCLES: [["image", "center_x_px", "center_y_px", "radius_px"], *circles],
        POSITIONS: [["image", "x_m", "y_m"], *positions],
    }
    for name, rows in tables.items():
        with (folder / name).open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows(rows)


def frame_noise(truth: PlantTruth, *, count: int = 40, first: int = 1) -> FrameNoise:
    """Measure what noise and JPEG do to frames of ``write_ball_presses`` inside the contacts."""
    camera = _Camera(truth)
    noise, recorded = [], []
    rows, columns = np.ogrid[: truth.unit.image_size[1], : truth.unit.image_size[0]]
    for press in camera.presses(count, first):
        column, row, radius_px = press.circle_px
        inside = np.hypot(columns - column, rows - row) < radius_px
        still = camera.scored(camera.raw(press))[inside].astype(np.float64)
        noisy = camera.scored(camera.raw(press, noise_seed=press.number))
        noise.append(np.abs(noisy[inside] - still).ravel())
        recorded.append(np.abs(camera.recorded(press)[inside] - still).ravel())
    means = (float(np.mean(np.concatenate(parts))) for parts in (noise, recorded))
    return FrameNoise(*means)


class _Camera:
    """The emulated sensor as a lab calibrates its optics: the ball is wetted and slips."""

    def __init__(self, truth: PlantTruth) -> None:
        self._truth = replace(truth, friction=0.0)
        self._unit = unit = truth.unit
        left, top = (math.floor(pixels * unit.crop) for pixels in _RAW_SIZE)
        self._border = left, top
        columns, rows = unit.image_size
        self._ratio = columns / (_RAW_SIZE[0] - 2 * left), rows / (_RAW_SIZE[1] - 2 * top)

    def presses(self, count: int, first: int) -> Iterator[_Press]:
        """Yield presses whose places fill the image evenly (R2 sequence)."""
        truth, unit, view = self._truth, self._unit, view_of(self._truth, _RAW_SIZE)
        table = press_table(case_for(_TIP, truth.poisson, gel=unit.gel))
        plastic = 1.324717957244746
        deepest_m = min(_DEPTHS_M[1], _DEEPEST_SHARE * unit.gel.thickness_m)
        reach_x, reach_y = (
            share * 0.5 * size * pixel
            for share, size, pixel in zip(_REACH, unit.image_size, unit.pixel_m, strict=True)
        )
        for k in range(first, first + count):
            u, v, w = k / plastic % 1.0, k / plastic**2 % 1.0, k * math.sqrt(0.5) % 1.0
            x, y = (2 * u - 1) * reach_x, (2 * v - 1) * reach_y
            depth_m = _DEPTHS_M[0] + w * (deepest_m - _DEPTHS_M[0])
            axis = (x + truth.pose_error_m[0], y + truth.pose_error_m[1])
            place, tilt = touched_at(axis, unit, _TIP)
            radius_m = float(np.interp(depth_m, table.depths, table.contact_radius))
            axes = zip(view.pixel(*place), self._border, self._ratio, strict=True)
            column, row = ((pixel + 0.5 - border) * by - 0.5 for pixel, border, by in axes)
            yield _Press(
                number=k,
                commanded_m=(x, y),
                depth_m=depth_m,
                touched_m=place,
                tilt_rad=tilt,
                circle_px=(column, row, radius_m / view.m_per_px[0] * self._ratio[0]),
            )

    def raw(self, press: _Press, *, noise_seed: int | None = None) -> ImageArray:
        """Return the raw frame of a press; no seed is no noise."""
        return render_press(
            self._truth,
            _TIP,
            press.depth_m,
            _RAW_SIZE,
            centre_m=press.touched_m,
            tilt_rad=press.tilt_rad,
            noise_seed=noise_seed,
        )

    def recorded(self, press: _Press) -> ImageArray:
        """Return the frame of a press as it is recorded, with noise and JPEG."""
        return self.scored(_sent(self.raw(press, noise_seed=press.number)))

    def averaged(self) -> ImageArray:
        """Return the no-contact frame averaged over its noise, as a lab averages it."""
        stack = [
            _sent(self.raw(_Press(), noise_seed=1000 + k)).astype(np.float32) for k in range(12)
        ]
        return self.scored(np.rint(np.mean(stack, axis=0)).astype(np.uint8))

    def scored(self, raw: ImageArray) -> ImageArray:
        """Return a raw frame without its border, at the size that is scored."""
        left, top = self._border
        cropped = raw[top : raw.shape[0] - top, left : raw.shape[1] - left]
        size = self._unit.image_size
        scaled = cv2.resize(np.ascontiguousarray(cropped), size, interpolation=cv2.INTER_AREA)
        return np.asarray(scaled, dtype=np.uint8)


def touched_at(
    axis: tuple[float, float], unit: EmulatedUnit, ball: SphereTip
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return where a ball on a domed gel touches [m], and how the contact is tilted there [rad].

    Ball and gel have one slope where they touch, beside the ball's axis and nearer to the gel's
    highest point; a ball itself cannot be tilted.
    """
    bend_x, bend_y = unit.dome_curvatures
    radius = ball.rim_radius_m
    place = (axis[0] / (1.0 + radius * bend_x), axis[1] / (1.0 + radius * bend_y))
    return place, (place[0] * bend_x, place[1] * bend_y)


def _sent(raw: ImageArray) -> ImageArray:
    """Return what is left of a raw frame after the camera's JPEG."""
    sent = decode_rgb(encode_jpeg(np.ascontiguousarray(raw[..., ::-1]), quality=_JPEG_QUALITY))
    return raw if sent is None else np.ascontiguousarray(sent[..., ::-1])
