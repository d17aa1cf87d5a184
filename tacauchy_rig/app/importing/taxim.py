"""Ball presses of Taxim's calibration sets: ``dataPack.npz``, alone or within the ``taxim`` wheel.

Taxim: Si and Yuan, RA-L 2022. Each set is a no-contact frame (``f0``), images of a pressed ball
(``imgs``) and a circle that was drawn into each (``touch_center``: column and row of the contact's
middle, ``touch_radius``: of its edge [px]). It states neither force nor depth, place, time or ball.
"""

from collections.abc import Mapping, Sequence
from enum import StrEnum
from functools import partial

import numpy as np

from tacauchy_rig.app.importing.press_detection import ORDER_NS, Frame, Press, Recorded
from tacauchy_rig.app.importing.source_files import (
    ARRAY_BYTES,
    IMAGE_PIXELS,
    Source,
    archive,
    read_member,
    read_npz,
)
from tacauchy_rig.core.arrays import AnyArray, ImageArray
from tacauchy_rig.core.config.field_ranges import Section
from tacauchy_rig.core.errors import RecordError, whole
from tacauchy_rig.core.image_codec import encode_png

_WANTED = ("f0", "imgs", "touch_center", "touch_radius")
_UNKNOWN = (
    "The size of the ball and the scale of the images are not known.",
    "The tilt of the indenter is not known.",
)
_ORDER = "No times were stated: the stamps of this run count images."
_BALL = (
    "The diameter of the ball is stated by whoever imports. At the same radius of contact, a ball "
    "twice as large is pressed half as deep, and its gel slopes half as much; colours are fitted "
    "to these slopes. A wrong diameter hardly changes images of this ball, but slopes under "
    "other indenters and all depths are then wrong by the same factor."
)
_FOUND = (
    "The circles drawn into this set's images are about twice as wide as what the ball touches, so "
    "they are left out and contacts are found in the images."
)


_ARRAYS = (
    "f0 [height, width, 3] and imgs [n, height, width, 3] are uint8 of one size, touch_center "
    "[n, 2] and touch_radius [n] lie within them [px]"
)
_inconsistent = partial(RecordError, remedy=_ARRAYS)


class TaximSet(StrEnum):
    """Sets of the wheel; each has its own folder in it."""

    GELSIGHT = "gelsight"
    GELSIGHT_MINI = "gelsight_mini"


ASSUMED: Mapping[TaximSet, Mapping[str, str]] = {
    TaximSet.GELSIGHT: {"sensor.name": "taxim-gelsight", "replay.indenter": "sphere:diameter=4mm"},
    TaximSet.GELSIGHT_MINI: {
        "sensor.name": "taxim-gelsight-mini",
        "replay.indenter": "sphere:diameter=2mm",
    },
}
"""Of each set what nothing in it says: balls with which its own images fit well
(docs/results/importing.md has the scores of others)."""


class TaximData(Section):
    """``[data]`` of Taxim's presses; without ``circles`` contacts are found in the images."""

    file: str
    set: TaximSet | None = None
    circles: bool | None = None


def read_taxim(source: Source, data: TaximData) -> Recorded:
    """Read a set of ball presses.

    Raises:
        RecordError: It is no such file, or its arrays do not belong together.
    """
    packed, name = source.read(data.file, field="data.file", most_bytes=ARRAY_BYTES), data.file
    if name.endswith(".whl"):
        with archive(packed, name=name) as wheel:
            member = _member(wheel.namelist(), data)
            packed, name = read_member(wheel, member, name=name), f"{name}: {member}"
    found = read_npz(packed, name=name, wanted=_WANTED)
    frame, images = found["f0"], found["imgs"]
    if frame.dtype != np.uint8 or frame.ndim != 3 or frame.shape[2:] != (3,):
        raise _inconsistent(f"{name}: f0 is {frame.shape} of {frame.dtype}")
    if images.dtype != np.uint8 or images.shape[1:] != frame.shape:
        raise _inconsistent(
            f"{name}: imgs is {images.shape} of {images.dtype}, f0 is {frame.shape}"
        )
    if not 0 < frame.shape[0] * frame.shape[1] <= IMAGE_PIXELS:
        raise _inconsistent(f"{name}: f0 is {frame.shape[1]} x {frame.shape[0]} px")
    drawn = _circles(found, name)
    taken = data.set is not TaximSet.GELSIGHT_MINI if data.circles is None else data.circles
    return Recorded(
        presses=tuple(
            _press(k, frame, image, drawn[k] if taken else None) for k, image in enumerate(images)
        ),
        has_clock=False,
        unknown=_UNKNOWN,
        notes=(_ORDER, _BALL) if taken else (_ORDER, _BALL, _FOUND),
        rig=ASSUMED[data.set] if data.set else {},
        name=f"taxim-{data.set}" if data.set else "taxim",
    )


def _member(there: Sequence[str], data: TaximData) -> str:
    """Return which of the wheel's members a set is."""
    known = {each: f"taxim/calib/{each}/dataPack.npz" for each in TaximSet}
    known = {each: member for each, member in known.items() if member in there}
    if data.set not in known:
        raise RecordError(
            f"data.set: {data.set!s} is no set of {data.file}",
            remedy=f"--set data.set= one of: {', '.join(known)}"
            if known
            else "it is not the wheel of `pip download taxim --no-deps`",
        )
    return known[data.set]


def _circles(found: Mapping[str, AnyArray], name: str) -> list[tuple[float, float, float]]:
    """Return column, row and radius of each contact's edge [px]."""
    centres, radii = found["touch_center"], found["touch_radius"]
    count, height, width, _ = found["imgs"].shape
    if centres.shape != (count, 2) or radii.shape != (count,):
        raise _inconsistent(f"{name}: {centres.shape} and {radii.shape} circles for {count} images")
    with whole(name, "set of circles", remedy=_ARRAYS):
        circles = np.column_stack([centres, radii]).astype(np.float64)
    inside = (circles >= 0.0) & (circles <= [width, height, width])
    for k in np.flatnonzero(~inside.all(axis=1) | ~(circles[:, 2] > 0.0)):
        raise _inconsistent(f"{name}: press {k + 1} has its circle at {circles[k].tolist()} px")
    return [(x, y, radius) for x, y, radius in circles.tolist()]


def _press(
    index: int, frame: ImageArray, image: ImageArray, circle: tuple[float, float, float] | None
) -> Press:
    unloaded, pressed = ORDER_NS, 2 * ORDER_NS
    name = f"imgs[{index}]"
    return Press(
        name=name,
        frames=(
            Frame(stamp_ns=unloaded, name=f"{name}, no contact", read=partial(_png, frame)),
            Frame(stamp_ns=pressed, name=f"{name}, pressed", read=partial(_png, image)),
        ),
        reference=(unloaded, unloaded),
        dwell=(pressed, pressed),
        contact_px=circle,
    )


def _png(bgr: ImageArray) -> bytes:
    """Return an image as PNG; OpenCV, which read it for them, has blue first."""
    return encode_png(np.ascontiguousarray(bgr[..., ::-1]))
