"""Images of others as the sensor's camera would have given them: whole, upright, of one size."""

import io
import math
import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Literal

import cv2
import numpy as np
from PIL import Image

from reports.scores.contact_scores import contact_footprint, image_change
from sim.sensor.camera_geometry import CameraGeometry
from tacauchy_rig.app.importing.source_files import IMAGE_PIXELS, Problems, at_most
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.config.field_ranges import Section
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.image_codec import ColourOrder, decode_rgb, encode_png

_KINDS = ("JPEG", "PNG")
_MODES = ("RGB", "L")
_ORIENTATION = 0x0112
"""EXIF's tag of how a viewer is to turn an image."""
_AS_STORED = 1
_LIBJPEG = (b"Corrupt JPEG data", b"Premature end", b"Inconsistent progression", b"Invalid SOS")
"""Begin its warnings of damage."""
ASPECT = 0.02
"""Relative difference of aspect ratios that is no squeezing: of cameras whose modes are rounded."""
_TURNS = {90: cv2.ROTATE_90_CLOCKWISE, 180: cv2.ROTATE_180, 270: cv2.ROTATE_90_COUNTERCLOCKWISE}
SWAPPED_SHARE = 0.5
"""Of the difference from the no-contact frame: so much less with channels swapped is no chance."""
SWAPPED_LEVELS = 5.0
"""[grey level] that a swap has to gain: less is noise on a nearly grey sensor."""
APART_M = 1e-3
"""RMS distance of contacts in images from their middle: less shows no direction."""
CHANGED_LEVELS = 8.0
"""[grey level] beside contacts: one unit's gels differ by 15, images of one gel by 1 to 2."""
Size = tuple[int, int]
Place = tuple[float, float]


class Images(Section):
    """``[images]``: by what convention all images of the source were stored."""

    turn: Literal[0, 90, 180, 270] = 0
    colour_order: ColourOrder = ColourOrder.RGB
    cropped: bool = False


@lru_cache(maxsize=4)  # presses may share one image at rest
def opened(data: bytes, *, name: str) -> tuple[Size, int]:
    """Return width and height [px] of a JPEG or PNG as it is stored, and how EXIF turns it.

    Raises:
        RecordError: It is another kind, damaged, not of 8 bits, or larger than any camera's.
    """
    damage = ""
    try:
        with Image.open(io.BytesIO(data), formats=_KINDS) as image:
            width, height = image.size
            told = f"image {name}: says that it is {width} x {height} px"
            at_most(IMAGE_PIXELS, width * height, told, remedy="scale it down, or leave it out")
            bits = data[24] if image.format == "PNG" else 8  # Pillow cuts 16 off to the upper 8
            if image.mode not in _MODES or bits > 8:
                raise RecordError(
                    f"image {name}: of the kind {image.mode} of {bits} bits; 8 bits of colour or "
                    "grey are read",
                    remedy="convert it to RGB with 8 bits a channel",
                )
            if image.format == "PNG":
                image.load()
            else:
                damage = _damage(data)
            turned = int(image.getexif().get(_ORIENTATION, _AS_STORED))
            kind = image.format
    except (Image.DecompressionBombError, OSError, ValueError, SyntaxError) as error:
        # Pillow raises a SyntaxError where a PNG is broken.
        kind, damage = "JPEG or PNG", str(error).partition(" <")[0]
    if damage:
        raise RecordError(
            f"image {name}: no whole {kind} ({len(data)} bytes): {damage}",
            remedy="replace the file, or leave its row out",
        )
    return (width, height), turned


def _damage(data: bytes) -> str:
    """Return what libjpeg says of a JPEG while it is decoded; empty where it is whole.

    It goes on behind damage, with grey or shifted blocks, and warns on standard error alone, where
    other threads say how far they are: that is passed on.
    """
    with tempfile.TemporaryFile() as told:
        kept = os.dup(2)
        os.dup2(told.fileno(), 2)
        try:
            image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
        finally:
            os.dup2(kept, 2)
            os.close(kept)
        told.seek(0)
        lines = told.read().splitlines(keepends=True)
    damage = [line.decode().strip() for line in lines if line.startswith(_LIBJPEG)]
    os.write(2, b"".join(line for line in lines if not line.startswith(_LIBJPEG)))
    return damage[0] if damage else "it cannot be decoded" * (image is None)


@dataclass(slots=True, kw_only=True)
class Converter:
    """Makes images of a source such as the sensor's camera gives."""

    how: Images  # the source's convention
    camera: CameraGeometry  # of the sensor
    notes: dict[str, None] = field(default_factory=dict)  # what was made of images, a sentence each
    # An image of each press and its image at rest, scaled down, by the press's name
    pairs: dict[str, tuple[ImageArray, ImageArray]] = field(default_factory=dict)

    def check_pairs(self, problems: Problems, places: Mapping[str, Place | None]) -> None:
        """Note channels in another order than at rest, images of two presses, and turned ones."""
        pairs = self.pairs
        if swapped := exchanged_channels([*pairs.values()]):
            problems.add(
                f"images pressed are {swapped[0]:.1f} grey levels from those at rest; with red and "
                f"blue exchanged {swapped[1]:.1f}",
                remedy="write both in one order of channels; images.colour_order is of all",
            )
        first: dict[bytes, str] = {}
        met = {name: first.setdefault(image.tobytes(), name) for name, (image, _) in pairs.items()}
        if again := [f"press {name} that of {of}" for name, of in met.items() if of != name]:
            self.notes[
                f"{len(again)} of {len(pairs)} presses have the same image as an earlier one, "
                f"{again[0]}: check that no row is there twice and the camera did not stand still."
            ] = None
        known = [(*pairs[name], place) for name, place in places.items() if place and name in pairs]
        if lie := how_contacts_lie(known, self.camera):
            note = f"Contacts in {len(known)} images {lie}: check columns, units and signs of x and"
            self.notes[f"{note} y, images.turn, and whose images these are."] = None
        # A quarter of an image is beside the contact even of large indenters.
        changes = [image_change(*pair) for pair in pairs.values()]
        least = [np.quantile(np.abs(c - np.median(c, axis=(0, 1))), 0.25) for c in changes]
        if least and (level := np.median(least)) > CHANGED_LEVELS:
            note = f"Images pressed are {level:.0f} grey levels from those at rest beside contacts:"
            self.notes[f"{note} check that both are of one gel, camera, light and exposure."] = None

    def compare(self, press: str, data: bytes, rest: bytes) -> None:
        """Keep an image of a press and its image at rest for ``check_pairs``."""
        image, still = _reduced(data), _reduced(rest)
        if image is not None and still is not None:
            self.pairs[press] = image, still

    def convert(self, data: bytes, *, name: str, rest: bytes | None) -> tuple[bytes, Size]:
        """Return an image's bytes, as they are where nothing has to be changed, and its size.

        Args:
            rest: The converted image of the gel at rest; None for that image itself.

        Raises:
            RecordError: It is damaged, or of another size than the camera or the image at rest.
        """
        size, exif = opened(data, name=name)
        if exif == _AS_STORED and self.how == Images() and self._is_large(size):
            self._check(size, name, rest)
            return data, size
        image = self._fitting(data, exif, rest)
        if self.how.colour_order is ColourOrder.BGR:
            image = image[..., ::-1]
        self._check((image.shape[1], image.shape[0]), name, None)
        image = self._enlarged(image)
        size = (image.shape[1], image.shape[0])
        self._check(size, name, rest)
        return encode_png(np.ascontiguousarray(image)), size

    def _fitting(self, data: bytes, exif: int, rest: bytes | None) -> ImageArray:
        """Return an image as EXIF turns it, or as it is stored where only that fits the rest."""
        upright = self._turned(data, cv2.IMREAD_COLOR)
        if exif == _AS_STORED:
            return upright
        if rest is None:
            self.notes["EXIF turns the image at rest, and so it was taken."] = None
            return upright
        stored = self._turned(data, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
        still = np.asarray(decode_rgb(rest))
        is_stored = _apart(stored, still) < _apart(upright, still)
        did = "as stored" if is_stored else "as EXIF turns it"
        note = f"Images that EXIF turns were taken so that they fit the image at rest: {did}."
        self.notes[note] = None
        return stored if is_stored else upright

    def _turned(self, data: bytes, flag: int) -> ImageArray:
        image = np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), flag), np.uint8)[..., ::-1]
        turn = _TURNS.get(self.how.turn)
        return image if turn is None else np.asarray(cv2.rotate(np.ascontiguousarray(image), turn))

    def _is_large(self, size: Size) -> bool:
        """Return whether at least what is scored is left of an image after the crop."""
        left = [side - 2 * int(side * self.camera.crop_fraction) for side in size]
        return left[0] >= self.camera.width and left[1] >= self.camera.height

    def _enlarged(self, image: ImageArray) -> ImageArray:
        """Return an image of which the crop leaves what is scored."""
        height, width = image.shape[:2]
        scored = (self.camera.width, self.camera.height)
        told, left = f"Images of {width} x {height} px", 1.0 - 2.0 * self.camera.crop_fraction
        if self.how.cropped:
            note = f"{told} were stated to be cropped; a border was put around for the crop."
            self.notes[note] = None
            inner = np.asarray(cv2.resize(image, scored, interpolation=cv2.INTER_AREA))
            # The crop takes such a border off with it.
            across, down = (int(side * self.camera.crop_fraction / left) for side in scored)
            edge = cv2.BORDER_REPLICATE
            return np.asarray(cv2.copyMakeBorder(inner, down, down, across, across, edge))
        if self._is_large((width, height)):
            return image
        note = (
            f"{told} were taken as whole frames and enlarged, since fewer than the "
            f"{scored[0]} x {scored[1]} px that are scored are left after the sensor's crop; "
            "state images.cropped = true if they were cropped already."
        )
        self.notes[note] = None
        whole = (math.ceil(scored[0] / left) + 2, math.ceil(scored[1] / left) + 2)
        return np.asarray(cv2.resize(image, whole, interpolation=cv2.INTER_LINEAR))

    def _check(self, size: Size, name: str, rest: bytes | None) -> None:
        """Refuse an image of another shape than the camera's or the image at rest."""
        told = f"image {name}: {size[0]} x {size[1]} px"
        if rest is not None and (still := opened(rest, name="at rest")[0]) != size:
            raise RecordError(
                f"{told}; its image at rest has {still[0]} x {still[1]} px",
                remedy="take both with one camera mode, and turn none of them",
            )
        want, is_now = self.camera.width / self.camera.height, size[0] / size[1]
        if abs(is_now / want - 1.0) <= ASPECT:
            return
        why, remedy = "", "cut images to the sensor's aspect ratio, or name another sensor: "
        remedy += "squeezed they would not be to scale"
        if abs(want * is_now - 1.0) <= ASPECT:
            why = ": it is turned by a quarter"
            remedy = "state images.turn = 90 or 270 if all are turned, or turn the image"
        raise RecordError(
            f"{told}, an aspect ratio of {is_now:.3f}; the sensor's is {want:.3f}{why}",
            remedy=remedy,
        )


@lru_cache(maxsize=4)
def _reduced(data: bytes) -> ImageArray | None:
    return decode_rgb(data, reduction=8)


def _apart(image: ImageArray, still: ImageArray) -> float:
    """Return how far images are from each other [grey level]; infinite for unlike sizes."""
    if image.shape != still.shape:
        return float("inf")
    return float(np.abs(image.astype(np.int16) - still.astype(np.int16)).mean())


def exchanged_channels(
    pairs: Sequence[tuple[ImageArray, ImageArray]],
) -> tuple[float, float] | None:
    """Return how far images are from those at rest as stated, and with red and blue exchanged.

    Returns:
        Medians over the pairs [grey level]; None where they do not look like those at rest only
        with channels exchanged.
    """
    if not pairs:
        return None
    as_stated = float(np.median([_apart(image, rest) for image, rest in pairs]))
    swapped = float(np.median([_apart(image[..., ::-1], rest) for image, rest in pairs]))
    is_likelier = swapped < SWAPPED_SHARE * as_stated and as_stated - swapped > SWAPPED_LEVELS
    return (as_stated, swapped) if is_likelier else None


def how_contacts_lie(
    presses: Sequence[tuple[ImageArray, ImageArray, Place]], camera: CameraGeometry
) -> str:
    """Return how contacts lie otherwise than where was pressed [m]; empty where that is not so.

    Few presses, or at one place, cannot tell. As complex numbers places seen are ``a`` times those
    stated, or ``a`` times their conjugates where images, frames scaled down, are mirrored.
    """
    size, both = np.array((camera.width, camera.height)) / (1.0 - 2.0 * camera.crop_fraction), []
    for image, rest, place in presses:
        if (shown := contact_footprint(image_change(image, rest))) is not None:
            seen = np.argwhere(shown)[:, ::-1].mean(axis=0) / shown.shape[::-1] * size
            both.append((seen, camera.to_pixels(np.array(place))))
    if len(both) < 4:
        return ""
    seen, stated = ((np.array(both) - np.mean(both, axis=0)) @ (1.0, 1.0j)).T
    far, stated_far = float(np.linalg.norm(seen)), float(np.linalg.norm(stated))
    if not stated_far or far * camera.mean_scale_m < APART_M * len(both) ** 0.5:
        return ""
    turned, mirrored = np.vdot(stated, seen), np.vdot(stated.conj(), seen)
    is_mirrored = bool(abs(mirrored) > 1.2 * abs(turned))
    fitting = mirrored if is_mirrored else turned
    degrees, times = round(math.degrees(np.angle(fitting))), far / stated_far
    if abs(fitting) < 0.5 * far * stated_far:
        return "do not lie where the source says it pressed"
    if is_mirrored or abs(degrees) > 60:
        told = "mirrored top to bottom and " * is_mirrored
        return f"lie as if images were {told}turned by {degrees} degrees against the stated places"
    return f"lie {times:.2g} times as far apart as the stated places" if times > 3.0 else ""
