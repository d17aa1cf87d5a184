"""Write a simulator's outputs in the plain layout; arrays in SI."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from tacauchy_rig.app.judging.description import (
    DESCRIPTION,
    FIELDS,
    FORCES,
    HEIGHT,
    IMAGE,
    PRESSURE,
    SHEAR,
)
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.outputs import Outputs
from tacauchy_rig.core.rgb import ColourOrder, encode_png
from tacauchy_rig.core.store.durable import write_atomically

UNITS = {"force": "N", "depth": "m", "height": "m", "pressure": "Pa"}


def check_empty(folder: Path) -> None:
    """Refuse a folder that holds something, before much is computed for it.

    Raises:
        RecordError: It does, or is none.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise RecordError(
            f"{folder}: is not empty, and old presses must not mix with new ones",
            remedy="give --out another folder, or empty it",
        )


def write_outputs(folder: Path, outputs: Outputs) -> None:
    """Write a folder that ``judge`` takes.

    Raises:
        RecordError: It is not empty, or cannot be written.
    """
    check_empty(folder)
    write_atomically(folder / DESCRIPTION, _description(outputs).encode())
    if lines := _forces(outputs):
        write_atomically(folder / FORCES, "\n".join([*lines, ""]).encode())
    for trial, press in outputs.presses.items():
        place = folder / f"{trial:02d}"
        if press.image is not None:
            write_atomically(place / IMAGE, encode_png(press.image))
        if press.height_m is not None:
            write_atomically(place / HEIGHT, _saved(press.height_m))
        fields = {} if press.pressure_pa is None else {PRESSURE: press.pressure_pa}
        if press.shear_pa is not None:
            fields |= dict(zip(SHEAR, np.moveaxis(press.shear_pa, -1, 0), strict=True))
        if fields:
            write_atomically(place / FIELDS, _saved(**fields))


def _description(outputs: Outputs) -> str:
    """Return ``simulator.toml``; a string, number or list is in TOML what it is in JSON."""
    simulator = outputs.simulator
    said: dict[str, Any] = {
        "name": simulator.name,
        "version": simulator.version,
        "colour_order": ColourOrder.RGB.value,
        "milliseconds_an_image": simulator.milliseconds_an_image,
        "machine": simulator.machine,
        "fitted_to_these": simulator.fitted_to_these,
        "driven_by": simulator.driven_by,
        "left_out": list(outputs.left_out),
        "note": simulator.note,
    }
    lines = [f"{key} = {_toml(value)}" for key, value in said.items() if value is not None]
    units = [f"{key} = {_toml(value)}" for key, value in UNITS.items()]
    return "\n".join([*lines, "", "[units]", *units, ""])


def _toml(value: object) -> str:
    return json.dumps(value, ensure_ascii=False)


def _forces(outputs: Outputs) -> list[str]:
    known = {
        trial: press
        for trial, press in outputs.presses.items()
        if press.force_n is not None or press.depth_m is not None
    }
    rows = [
        f"{trial},{_cell(press.force_n)},{_cell(press.depth_m)}" for trial, press in known.items()
    ]
    return ["press,force,depth", *rows] if rows else []


def _cell(value: float | None) -> str:
    return "" if value is None else repr(value)


def _saved(array: np.ndarray | None = None, **arrays: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    if array is not None:
        np.save(buffer, array.astype(np.float32), allow_pickle=False)
    else:
        np.savez_compressed(
            buffer, allow_pickle=False, **{k: v.astype(np.float32) for k, v in arrays.items()}
        )
    return buffer.getvalue()
