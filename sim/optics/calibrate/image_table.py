"""Tables of images: CSV files with an image's name and some numbers a line."""

from __future__ import annotations

import csv
import math
from pathlib import Path

from tacauchy_rig.core.errors import ConfigError

_IMAGE = "image"


def read_image_table(
    path: Path, *, what: str, numbers: tuple[str, ...]
) -> list[tuple[str, str, list[float]]]:
    """Read a table with the column image and those of some numbers, in any order.

    Of each line: where it stands, for messages; the image's name; its numbers.

    Raises:
        ConfigError: The table is missing or damaged; the message names the line and the column.
    """
    columns = (_IMAGE, *numbers)
    remedy = f"give a CSV in UTF-8 with the columns {', '.join(columns)}"
    try:
        with path.open(newline="", encoding="utf-8-sig") as table:
            reader = csv.DictReader(table)
            lines = [(f"{path}, line {reader.line_num}", row) for row in reader]
    except OSError as error:
        raise ConfigError(
            f"{what} {path} cannot be read: {error.strerror}", remedy=remedy
        ) from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"{what} {path} is no CSV: {error}", remedy=remedy) from error
    missing = [name for name in columns if name not in (reader.fieldnames or ())]
    if missing:
        raise ConfigError(
            f"{path} lacks the column {', '.join(missing)}",
            remedy=f"its first line must be: {','.join(columns)}",
        )
    found = []
    for place, row in lines:
        if not row[_IMAGE]:
            raise ConfigError(f"{place}: names no image", remedy=f"give {', '.join(columns)}")
        found.append(
            (place, row[_IMAGE], [_number(row[name], f"{place}: {name}") for name in numbers])
        )
    return found


def _number(text: str | None, field: str) -> float:
    try:
        value = float(text or "")
    except ValueError as error:
        raise ConfigError(f"{field}: {error}", remedy="give a number") from error
    if not math.isfinite(value):
        raise ConfigError(f"{field} is {value:g}", remedy="give a finite number")
    return value
