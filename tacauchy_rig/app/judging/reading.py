"""Read a simulator's folder; what is missing, odd or hostile is refused by name."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tacauchy_rig.app.importing.images import (
    apart_as_stated_and_swapped,
    are_swapped,
    image_size,
)
from tacauchy_rig.app.importing.source import (
    ARRAY_BYTES,
    IMAGE_BYTES,
    Source,
    members,
    read_member,
    read_npy,
)
from tacauchy_rig.app.importing.table import read_table
from tacauchy_rig.app.judging.conventions import check_conventions
from tacauchy_rig.app.judging.layout import (
    DESCRIPTION,
    DIMENSIONS,
    FIELDS,
    FORCES,
    HEIGHT,
    IMAGE,
    PRESSURE,
    SHEAR,
    Description,
    read_description,
)
from tacauchy_rig.core.arrays import AnyArray, FloatArray, ImageArray
from tacauchy_rig.core.errors import ConfigError, RecordError, RigError
from tacauchy_rig.core.rgb import ColourOrder, decode_rgb
from tacauchy_rig.core.simulated import Outputs, PressOutput

NPY = ".npy"


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """What of a run a simulator's folder has to answer.

    Attributes:
        trials: Their numbers, which are its folders' names.
        size_px: Width and height of the scored images [px].
        references: No-contact frames by trial, as far as they can be read.
        measured: Force [N] and depth [m] by trial; None is not known.
        pixel_m2: Area of the gel that a pixel sees [m^2]; 0 is not known.
    """

    trials: tuple[int, ...]
    size_px: tuple[int, int]
    references: Mapping[int, ImageArray]
    measured: Mapping[int, tuple[float | None, float | None]] = field(default_factory=dict)
    pixel_m2: float = 0.0


def read_outputs(folder: Path, asked: Asked) -> Outputs:
    """Read a simulator's outputs for the presses of a run.

    Raises:
        RecordError: A press is missing, or a file is odd; names file, value and remedy.
        ConfigError: ``simulator.toml`` is damaged, or a unit or the colour order is not stated.
    """
    try:
        return _read(Source(folder), asked)
    except RigError as error:
        raise type(error)(f"{folder}: {error.message}", remedy=error.remedy) from error


def _read(source: Source, asked: Asked) -> Outputs:
    about = read_description(source)
    folders = _folders(source, asked, about)
    forces = _forces(source, asked, about)
    presses: dict[int, PressOutput] = {}
    for trial in asked.trials:
        if trial in about.left_out:
            continue
        if trial not in folders and trial not in forces:
            raise RecordError(
                f"press {trial} is missing: no folder {trial:02d} and no line in {FORCES}",
                remedy=f"simulate it, or admit it: left_out = [{trial}] in {DESCRIPTION}",
            )
        force, depth = forces.get(trial, (None, None))
        shown = _shown(source, folders[trial], asked, about) if trial in folders else {}
        presses[trial] = PressOutput(force_n=force, depth_m=depth, **shown)
    _check_all_or_none(presses)
    _check_colours(presses, asked, about)
    check_conventions(presses, asked.measured, asked.pixel_m2, source.problems)
    source.problems.refuse()
    return Outputs(
        simulator=about.simulator, presses=presses, left_out=tuple(sorted(about.left_out))
    )


def _folders(source: Source, asked: Asked, about: Description) -> dict[int, str]:
    """Return the folders of presses by trial; files and other folders are no business of ours."""
    found: dict[int, str] = {}
    for path in sorted(source.root.iterdir()):
        if not (path.name.isascii() and path.name.isdecimal()):
            continue
        trial = int(path.name[:9])
        if trial in found or trial not in asked.trials or not path.is_dir():
            raise RecordError(
                f"{path.name}: the run has no such press, or has it already"
                f" (presses {asked.trials[0]} to {asked.trials[-1]})",
                remedy="one folder a press, named by its number: 01, 02, ...",
            )
        if trial in about.left_out:
            raise RecordError(
                f"{path.name}: {DESCRIPTION} lists this press as left out",
                remedy="take its number off left_out, or its folder away",
            )
        found[trial] = path.name
    return found


def _forces(
    source: Source, asked: Asked, about: Description
) -> dict[int, tuple[float | None, float | None]]:
    """Return force [N] and depth [m] by trial, as ``forces.csv`` has them."""
    if not (source.root / FORCES).exists():
        return {}
    table = read_table(source, FORCES, field="the forces")
    if about.driven_by is None:
        raise ConfigError(
            f"{DESCRIPTION}: driven_by is not stated, and {FORCES} has forces",
            remedy='write driven_by = "depth" (its forces are at the measured depths) or "force" '
            "(its depths are at the measured forces)",
        )
    columns = {}
    for name in ("force", "depth"):
        there = name in table.columns
        column = about.units.column(name, file=FORCES, signs=about.signs) if there else None
        columns[name] = table.numbers(column, DIMENSIONS[name], field=FORCES)
    found: dict[int, tuple[float | None, float | None]] = {}
    names = table.text("press", field=FORCES)
    source.problems.refuse()
    for row, (name, force, depth) in enumerate(
        zip(names, columns["force"].tolist(), columns["depth"].tolist(), strict=True)
    ):
        is_number = name.isascii() and name.isdecimal()
        trial = int(name[:9]) if is_number else -1
        if trial not in asked.trials or trial in found or trial in about.left_out:
            raise RecordError(
                f'{table.where(row)}: press "{name[:40]}" is none of the run, stands twice, or '
                "was left out",
                remedy=f"one line a press, {asked.trials[0]} to {asked.trials[-1]}",
            )
        found[trial] = (None if np.isnan(force) else force, None if np.isnan(depth) else depth)
    return found


def _shown(source: Source, folder: str, asked: Asked, about: Description) -> dict[str, Any]:
    """Return image, heights, pressure and shear of a press, as far as they are there."""
    found: dict[str, Any] = {}
    width, height = asked.size_px
    root = source.root / folder
    if (root / IMAGE).exists():
        found["image"] = _image(source, f"{folder}/{IMAGE}", asked, about)
    if (root / HEIGHT).exists():
        name = f"{folder}/{HEIGHT}"
        unit = about.units.column("height", file=name, signs=about.signs)
        factor = unit.factor(DIMENSIONS["height"], field=DESCRIPTION)
        found["height_m"] = factor * _read_pixels(source, name, (height, width))
    if (root / FIELDS).exists():
        name = f"{folder}/{FIELDS}"
        unit = about.units.column(PRESSURE, file=name, signs=about.signs)
        factor = unit.factor(DIMENSIONS[PRESSURE], field=DESCRIPTION)
        arrays = _read_fields(source, name, (height, width), known=(PRESSURE, *SHEAR))
        if PRESSURE in arrays:
            found["pressure_pa"] = factor * arrays[PRESSURE]
        if along := [arrays[key] for key in SHEAR if key in arrays]:
            if len(along) < len(SHEAR):
                raise RecordError(
                    f"{name}: holds one of {' and '.join(SHEAR)} without the other",
                    remedy="give the shear on the gel along the pad's x and along its y",
                )
            found["shear_pa"] = abs(factor) * np.stack(along, axis=-1)
    if not found:
        raise RecordError(
            f"{folder}: holds none of {IMAGE}, {HEIGHT} and {FIELDS}",
            remedy="put there what was simulated, or take the folder away",
        )
    return found


def _image(source: Source, name: str, asked: Asked, about: Description) -> ImageArray:
    data = source.read(name, field="an image", most_bytes=IMAGE_BYTES)
    size = image_size(data, name=name)
    if size != asked.size_px:
        raise RecordError(
            f"{name}: is {size[0]} x {size[1]} px; the run's images are scored at "
            f"{asked.size_px[0]} x {asked.size_px[1]} px",
            remedy="crop and resize as the run's sensor does: `judge --task` writes a frame of it",
        )
    if about.colour_order is None:
        raise ConfigError(
            f"{DESCRIPTION}: colour_order is not stated, and there are images",
            remedy='write "RGB" if a viewer shows red as red, "BGR" if it shows red as blue',
        )
    image = decode_rgb(data)
    if image is None:
        raise RecordError(f"{name}: no readable image", remedy="write it as PNG with 8 bits")
    return np.ascontiguousarray(
        image[..., ::-1] if about.colour_order is ColourOrder.BGR else image
    )


def _check_all_or_none(presses: Mapping[int, PressOutput]) -> None:
    """Refuse a folder that has something of some presses and not of others."""
    for name, what in (
        ("image", IMAGE),
        ("height_m", HEIGHT),
        ("pressure_pa", f"{PRESSURE} in {FIELDS}"),
        ("shear_pa", f"shear in {FIELDS}"),
        ("force_n", f"a force in {FORCES}"),
        ("depth_m", f"a depth in {FORCES}"),
    ):
        without = [trial for trial, press in presses.items() if getattr(press, name) is None]
        if without and len(without) < len(presses):
            listed = ", ".join(map(str, without))
            raise RecordError(
                f"presses {listed} have no {what}, the others have",
                remedy="a mean over presses has to be of all: give it for each, or admit them as "
                f"left_out = [{listed}] in {DESCRIPTION}",
            )


def _check_colours(presses: Mapping[int, PressOutput], asked: Asked, about: Description) -> None:
    """Refuse images that look like the sensor only with red and blue exchanged."""
    pairs = [
        (press.image, asked.references[trial])
        for trial, press in presses.items()
        if press.image is not None and trial in asked.references
    ]
    if not pairs or about.colour_order is None:
        return
    as_stated, swapped = apart_as_stated_and_swapped(pairs)
    if are_swapped(as_stated, swapped):
        other = ColourOrder.RGB if about.colour_order is ColourOrder.BGR else ColourOrder.BGR
        raise RecordError(
            f'colour_order = "{about.colour_order.value}": so read, images are {as_stated:.1f} '
            f"grey levels from the no-contact frames; with red and blue exchanged {swapped:.1f}",
            remedy=f'write colour_order = "{other.value}", or exchange the channels',
        )


def _read_pixels(source: Source, name: str, shape: tuple[int, int]) -> FloatArray:
    """Read an array of finite numbers, one a pixel.

    Raises:
        RecordError: It is none, or of another shape.
    """
    data = source.read(name, field="an array", most_bytes=ARRAY_BYTES)
    return _pixels(read_npy(data, name=name), shape, where=name)


def _read_fields(
    source: Source, name: str, shape: tuple[int, int], *, known: Collection[str]
) -> dict[str, FloatArray]:
    """Read the arrays of an archive, each as by ``_read_pixels``.

    Args:
        known: Names that may be in it, and no others.

    Raises:
        RecordError: It is no archive of such arrays.
    """
    data = source.read(name, field="an archive", most_bytes=ARRAY_BYTES)
    there = sorted(each.removesuffix(NPY) for each in members(data, name=name))
    if not there or not set(there) <= set(known):
        raise RecordError(
            f"{name}: holds {', '.join(there)[:200] or 'nothing'}",
            remedy=f"what is judged: {', '.join(known)}",
        )
    found: dict[str, FloatArray] = {}
    for key in there:
        where = f"{name}, {key}"
        member = read_member(data, f"{key}{NPY}", name=name)
        found[key] = _pixels(read_npy(member, name=where), shape, where=where)
    return found


def _pixels(array: AnyArray, shape: tuple[int, int], *, where: str) -> FloatArray:
    if array.dtype.kind not in "fiu":
        raise RecordError(
            f"{where}: is of type {array.dtype}, not of numbers",
            remedy="save it as float64 or float32",
        )
    if array.shape != shape:
        raise RecordError(
            f"{where}: has the shape {list(array.shape)}; the scored image is {list(shape)} "
            "[height, width]",
            remedy="give one value a pixel of the scored image",
        )
    bad = np.argwhere(~np.isfinite(array))
    if len(bad):
        row, column = bad[0].tolist()
        raise RecordError(
            f"{where}: {len(bad)} of its values are no finite numbers, the first "
            f"{array[row, column]} in row {row}, column {column}",
            remedy="give every pixel a number: gel that is not touched has height 0, pressure 0",
        )
    return array.astype(np.float64)
