"""A folder of images with a CSV: a row an image, a force sample, or both."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from tacauchy_rig.app.importing.press import Recorded
from tacauchy_rig.app.importing.rows import Image, RowsData, presses_of
from tacauchy_rig.app.importing.source import IMAGE_BYTES, Source
from tacauchy_rig.app.importing.table import read_table


class CsvData(RowsData):
    """``[data]`` of a folder with a CSV.

    Attributes:
        table: The CSV.
        images: Folder of the images.
    """

    table: str = "presses.csv"
    images: str = "."


def read_csv_folder(source: Source, data: CsvData) -> Recorded:
    """Read a folder of images with a CSV.

    Raises:
        RecordError: A file is missing or odd; names it with line and column.
        ConfigError: A unit is not of what it is to measure.
    """
    table = read_table(source, data.table, field="data.table")
    images = source.folder(data.images, field="data.images").relative_to(source.root)
    prefix = "" if str(images) == "." else f"{images}/"
    return presses_of(table, data, image=image_files(source, prefix), at_rest=image_files(source))


def image_files(source: Source, prefix: str = "") -> Image:
    """Return what finds images that are files, below a folder."""

    def image(name: str, field: str) -> Callable[[], bytes]:
        source.path(prefix + name, field=field, most_bytes=IMAGE_BYTES)
        return partial(source.read, prefix + name, field=field, most_bytes=IMAGE_BYTES)

    return image
