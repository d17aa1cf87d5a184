"""Images of a ball of known size pressed into a sensor, and tables of them (CSV)."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sim.optics.markers.marker_tracking import MarkerTracks
from tacauchy_rig.core.arrays import AnyArray, BoolArray, FloatArray, ImageArray
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.image_codec import decode_rgb

_IMAGE = "image"
_COLUMNS = ("center_x_px", "center_y_px", "radius_px")


def read_image_table(
    path: Path, *, what: str, numbers: tuple[str, ...]
) -> list[tuple[str, str, list[float]]]:
    """Return of each line its place for messages, the image's name, and numbers by these columns.

    Raises:
        ConfigError: The table is missing or damaged; the message names the line and the column.
    """
    columns = ", ".join((_IMAGE, *numbers))
    remedy = f"give a CSV in UTF-8 with the columns {columns}"
    try:
        with path.open(newline="", encoding="utf-8-sig") as table:
            reader = csv.DictReader(table)
            lines = [(f"{path}, line {reader.line_num}", row) for row in reader]
    except OSError as error:
        wrong = f"{what} {path} cannot be read: {error.strerror}"
        raise ConfigError(wrong, remedy=remedy) from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"{what} {path} is no CSV: {error}", remedy=remedy) from error
    missing = [name for name in (_IMAGE, *numbers) if name not in (reader.fieldnames or ())]
    if missing:
        raise ConfigError(f"{path} lacks the column {', '.join(missing)}", remedy=remedy)
    for place, row in lines:
        if not row[_IMAGE]:
            raise ConfigError(f"{place}: names no image", remedy=f"give {columns}")
    return [
        (place, row[_IMAGE], [_number_of(row[name], f"{place}: {name}") for name in numbers])
        for place, row in lines
    ]


def _number_of(text: str | None, field: str) -> float:
    try:
        value = float(text or "")
    except ValueError as error:
        raise ConfigError(f"{field}: {error}", remedy="give a number") from error
    if not math.isfinite(value):
        raise ConfigError(f"{field} is {value:g}", remedy="give a finite number")
    return value


class Circle(NamedTuple):
    """Edge of a contact in the image [px]; pixel (0, 0) is the centre of the first pixel."""

    x_px: float
    y_px: float
    radius_px: float

    def distance(self, columns: AnyArray | float, rows: AnyArray | float) -> FloatArray:
        """Return how far pixels lie from its centre [px], in the shape of both together."""
        return np.asarray(np.hypot(columns - self.x_px, rows - self.y_px), dtype=np.float64)


@dataclass(frozen=True, slots=True, kw_only=True)
class BallPress:
    """One image of a pressed ball."""

    name: str
    image: ImageArray  # RGB, uint8, shape [height, width, 3]
    circle: Circle
    tracks: MarkerTracks | None = None  # of the gel's markers; None where it has none
    hidden: BoolArray | None = None  # where the gel is not seen, [height, width]; None is nowhere

    @property
    def shown(self) -> BoolArray:
        """True where the image shows the gel, shape [height, width]."""
        shape = self.image.shape[:2]
        return np.ones(shape, dtype=np.bool_) if self.hidden is None else ~self.hidden


def read_rgb(path: Path, *, field: str = "image") -> ImageArray:
    """Read an image file as RGB, uint8, shape [height, width, 3]; errors name the field.

    Raises:
        ConfigError: The file is missing or no image.
    """
    try:
        image = decode_rgb(path.read_bytes())
    except OSError as error:
        wrong = f"{field} {path} cannot be read: {error.strerror}"
        raise ConfigError(wrong, remedy="check the path") from error
    if image is None:
        raise ConfigError(f"{field} {path} is no whole PNG or JPEG", remedy="replace the file")
    return image


def read_ball_presses(folder: Path, circles: Path) -> list[BallPress]:
    """Read the images that a CSV with the columns image, center_x_px, center_y_px, radius_px names.

    Raises:
        ConfigError: The table or an image is missing or damaged; the message names the line.
    """
    lines = read_image_table(circles, what="circle table", numbers=_COLUMNS)
    if not lines:
        raise ConfigError(f"{circles} names no image", remedy="give one line per press")
    presses = []
    for place, name, (x, y, radius) in lines:
        if not radius > 0.0:
            raise ConfigError(
                f"{place}: radius {radius:g} px is not positive", remedy="give the contact's radius"
            )
        circle = Circle(x_px=x, y_px=y, radius_px=radius)
        presses.append(BallPress(name=name, image=read_rgb(folder / name), circle=circle))
    return presses


def check_presses_fit(presses: Sequence[BallPress], background: ImageArray) -> None:
    """Refuse presses that have not the size of the no-contact frame, or no contact inside it."""
    height, width = background.shape[:2]
    for press in presses:
        check_size(press.name, press.image, background)
        circle = press.circle
        if not (0.0 <= circle.x_px <= width - 1.0 and 0.0 <= circle.y_px <= height - 1.0):
            raise ConfigError(
                f"{press.name}: its circle is around column {circle.x_px:g}, row {circle.y_px:g}, "
                f"outside the image of {width} x {height} px",
                remedy="correct center_x_px and center_y_px",
            )


def check_size(name: str, image: ImageArray, background: ImageArray) -> None:
    """Refuse an image that has not the size of the no-contact frame."""
    if image.shape != background.shape:
        raise ConfigError(
            f"{name} is {image.shape[1]} x {image.shape[0]} px, the no-contact frame "
            f"{background.shape[1]} x {background.shape[0]} px",
            remedy="take both with the same camera mode, crop and size",
        )
