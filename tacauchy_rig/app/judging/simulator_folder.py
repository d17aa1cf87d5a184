"""Read a simulator's folder; what is missing, odd or hostile is refused by name.

A convention is no defeat: no simulator is wrong by a factor of a thousand in each press, or pulls
where all others press. Such outputs are refused by the key that declares their sign or unit.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tacauchy_rig.app.importing.image_conversion import exchanged_channels, opened
from tacauchy_rig.app.importing.plausibility import UNLIKE, unit_meant
from tacauchy_rig.app.importing.source_files import (
    ARRAY_BYTES,
    IMAGE_BYTES,
    Source,
    read_npy,
    read_npz,
)
from tacauchy_rig.app.importing.text_tables import read_table
from tacauchy_rig.app.judging.task_and_baseline import (
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
from tacauchy_rig.core.errors import ConfigError, RecordError, naming
from tacauchy_rig.core.image_codec import ColourOrder, decode_rgb
from tacauchy_rig.core.simulated import Outputs, PressOutput

Measured = tuple[float | None, float | None]
"""Force [N] and depth [m] of a press; None is not known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """What of a run a simulator's folder has to answer."""

    trials: tuple[int, ...]  # their numbers, which are its folders' names
    size_px: tuple[int, int]  # width and height of the scored images [px]
    references: Mapping[int, ImageArray]  # no-contact frames by trial, as far as they can be read
    measured: Mapping[int, Measured] = field(default_factory=dict)  # by trial
    pixel_m2: float = 0.0  # area of the gel that a pixel sees [m^2]; 0 is not known


def read_outputs(folder: Path, asked: Asked) -> Outputs:
    """Read a simulator's outputs for the presses of a run.

    Raises:
        RecordError: A press is missing, or a file is odd; names file, value and remedy.
        ConfigError: ``simulator.toml`` is damaged, or a unit or the colour order is not stated.
    """
    source = Source(folder)
    with naming(str(folder)):
        return _read(source, asked)


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
                remedy=f"simulate it, or list it: left_out = [{trial}] in {DESCRIPTION}",
            )
        force, depth = forces.get(trial, (None, None))
        shown = _shown(source, folders[trial], asked, about) if trial in folders else {}
        presses[trial] = PressOutput(force_n=force, depth_m=depth, **shown)
    _check_all_or_none(presses)
    _check_colours(presses, asked, about)
    for error in odd_conventions(presses, asked):
        source.problems.note(error)
    source.problems.refuse()
    return Outputs(
        simulator=about.simulator, presses=presses, left_out=tuple(sorted(about.left_out))
    )


def _is_number(name: str) -> bool:
    return name.isascii() and name.isdecimal()


def _trial(
    name: str, where: str, asked: Asked, about: Description, found: Mapping[int, Any]
) -> int:
    """Return the trial that a name is the number of. RecordError: It is not wanted, or found."""
    trial = int(name[:9]) if _is_number(name) else -1
    if trial not in asked.trials or trial in found or trial in about.left_out:
        raise RecordError(
            f'{where}: press "{name[:40]}" is none of the run, stands twice, or is listed as '
            f"left_out in {DESCRIPTION}",
            remedy=f"number presses {asked.trials[0]} to {asked.trials[-1]}, each once",
        )
    return trial


def _folders(source: Source, asked: Asked, about: Description) -> dict[int, str]:
    """Return the folders of presses by trial; files and other folders are no business of ours."""
    found: dict[int, str] = {}
    for path in sorted(source.root.iterdir()):
        if path.is_dir() and _is_number(path.name):
            found[_trial(path.name, path.name, asked, about, found)] = path.name
    return found


def _forces(source: Source, asked: Asked, about: Description) -> dict[int, Measured]:
    """Return force and depth by trial, as ``forces.csv`` has them."""
    if not (source.root / FORCES).exists():
        return {}
    table = read_table(source, FORCES, field="the forces")
    if about.driven_by is None:
        raise ConfigError(
            f"{DESCRIPTION}: driven_by is not stated, and {FORCES} has forces",
            remedy='write driven_by = "depth" (its forces are at the measured depths) or "force" '
            "(its depths are at the measured forces)",
        )
    values = []
    for name in ("force", "depth"):
        column = about.column(name, file=FORCES) if name in table.columns else None
        numbers = table.numbers(column, DIMENSIONS[name], field=FORCES).tolist()
        values.append([None if np.isnan(each) else each for each in numbers])
    names = table.text("press", field=FORCES)
    source.problems.refuse()
    found: dict[int, Measured] = {}
    for row, (name, force, depth) in enumerate(zip(names, *values, strict=True)):
        found[_trial(name, table.where(row), asked, about, found)] = force, depth
    return found


def _shown(source: Source, folder: str, asked: Asked, about: Description) -> dict[str, Any]:
    """Return image, heights, pressure and shear of a press, as far as they are there."""
    found: dict[str, Any] = {}
    there = {path.name for path in (source.root / folder).iterdir()}
    if IMAGE in there:
        found["image"] = _image(source, f"{folder}/{IMAGE}", asked, about)
    if HEIGHT in there:
        name = f"{folder}/{HEIGHT}"
        factor = about.factor("height", file=name)
        data = source.read(name, field="an array", most_bytes=ARRAY_BYTES)
        found["height_m"] = factor * _pixels(read_npy(data, name=name), asked, where=name)
    if FIELDS in there:
        name = f"{folder}/{FIELDS}"
        factor = about.factor(PRESSURE, file=name)
        arrays = _fields(source, name, asked)
        if PRESSURE in arrays:
            found["pressure_pa"] = factor * arrays[PRESSURE]
        along = [arrays[key] for key in SHEAR if key in arrays]
        if len(along) == 1:
            raise RecordError(
                f"{name}: holds one of {' and '.join(SHEAR)} without the other",
                remedy="give the shear on the gel along the pad's x and along its y",
            )
        if along:
            found["shear_pa"] = abs(factor) * np.stack(along, axis=-1)
    if not found:
        raise RecordError(
            f"{folder}: holds none of {IMAGE}, {HEIGHT} and {FIELDS}",
            remedy="put there what was simulated, or take the folder away",
        )
    return found


def _image(source: Source, name: str, asked: Asked, about: Description) -> ImageArray:
    data = source.read(name, field="an image", most_bytes=IMAGE_BYTES)
    size, _ = opened(data, name=name)
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


def _fields(source: Source, name: str, asked: Asked) -> dict[str, FloatArray]:
    """Return the arrays of an archive, which may hold those that are judged and no others."""
    data = source.read(name, field="an archive", most_bytes=ARRAY_BYTES)
    arrays = read_npz(data, name=name)
    if not arrays or not arrays.keys() <= {PRESSURE, *SHEAR}:
        raise RecordError(
            f"{name}: holds {', '.join(sorted(arrays))[:200] or 'nothing'}",
            remedy=f"what is judged: {', '.join((PRESSURE, *SHEAR))}",
        )
    return {key: _pixels(each, asked, where=f"{name}, {key}") for key, each in arrays.items()}


def _pixels(array: AnyArray, asked: Asked, *, where: str) -> FloatArray:
    """Return an array of finite numbers, one a pixel; raises a RecordError where it is none."""
    shape = asked.size_px[::-1]
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
                remedy="means are over all presses: give it for each, or list them as "
                f"left_out = [{listed}] in {DESCRIPTION}",
            )


def _check_colours(presses: Mapping[int, PressOutput], asked: Asked, about: Description) -> None:
    """Refuse images that look like the sensor only with red and blue exchanged."""
    pairs = [
        (press.image, asked.references[trial])
        for trial, press in presses.items()
        if press.image is not None and trial in asked.references
    ]
    if (levels := exchanged_channels(pairs)) and about.colour_order is not None:
        other = ColourOrder.RGB if about.colour_order is ColourOrder.BGR else ColourOrder.BGR
        raise RecordError(
            f'colour_order = "{about.colour_order.value}": so read, images are {levels[0]:.1f} '
            f"grey levels from the no-contact frames; with red and blue exchanged {levels[1]:.1f}",
            remedy=f'write colour_order = "{other.value}", or exchange the channels',
        )


UNITS_APART = 10.0**1.5  # half way from a unit to the next
_LIKELY = (1.0 / UNLIKE, UNLIKE)
_CONVENTIONS = {
    "force": ("N", "forces are positive in compression", _LIKELY),
    "depth": ("m", "depths are positive in compression", _LIKELY),
    "height": ("m into the gel", "heights are negative where the gel is pressed in", (0.01, 10.0)),
    PRESSURE: ("N over the image", "pressure is positive in compression", _LIKELY),
}
"""Of each output the unit that it is compared in, its sign, and what ratios are possible."""


def odd_conventions(presses: Mapping[int, PressOutput], asked: Asked) -> Iterator[RecordError]:
    """Yield what has another sign or unit than is stated, in all presses."""
    outputs = presses.values()
    known = [asked.measured.get(trial, (None, None)) for trial in presses]
    forces_n, depths_m = np.array(known, dtype=np.float64).reshape(-1, 2).T
    dents_m = [None if each.height_m is None else _dent_m(each.height_m) for each in outputs]
    pressures_pa = [None if (p := each.pressure_pa) is None else p.sum() for each in outputs]
    for what, ours, theirs in (
        ("force", _numbers(each.force_n for each in outputs), forces_n),
        ("depth", _numbers(each.depth_m for each in outputs), depths_m),
        ("height", _numbers(dents_m), depths_m),
        (PRESSURE, _numbers(pressures_pa) * asked.pixel_m2, forces_n),
    ):
        unit, rule, (least, most) = _CONVENTIONS[what]
        told = ours[~np.isnan(ours)]
        if len(told) and (told < 0.0).all():
            yield RecordError(
                f"{what} has the other sign in all {len(told)} presses, such as {told[0]:.4g} "
                f"{unit}",
                remedy=f"{rule}: write signs.{what} = -1 into {DESCRIPTION}",
            )
        ratios = np.abs(ours / np.where(theirs == 0.0, np.nan, theirs))
        ratios = ratios[ratios > 0.0]  # what is zero or not known is compared with nothing
        times = float(np.median(ratios)) if len(ratios) else 1.0
        if not least < times < most:
            yield RecordError(
                f"{what} is {times:.3g} times what was measured (median of {len(ratios)} presses)",
                remedy=f"correct units.{what} of {DESCRIPTION}"
                f"{unit_meant(DIMENSIONS[what], times, UNITS_APART)}",
            )


def _numbers(values: Iterable[float | None]) -> FloatArray:
    return np.array(list(values), dtype=np.float64)


def _dent_m(height_m: FloatArray) -> float:
    """Return how deep a surface is pressed in; less than zero of one that rather rises."""
    deepest, highest = -float(height_m.min()), float(height_m.max())
    return -highest if highest > 3.0 * max(deepest, 0.0) else deepest
