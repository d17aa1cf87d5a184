"""The formats that can be written, and what each takes."""

import errno
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from enum import StrEnum
from importlib import import_module
from pathlib import Path

from tacauchy_rig.app.sweep.engine_names import INDEX
from tacauchy_rig.core.errors import RecordError, RigError
from tacauchy_rig.core.store.atomic_write import free_bytes, write_error


class Format(StrEnum):
    """What can be written."""

    CSV = "csv"
    LEROBOT = "lerobot"
    HDF5 = "hdf5"
    ROSBAG2 = "rosbag2"
    WEBDATASET = "webdataset"
    ZARR = "zarr"
    VTU = "vtu"
    USD = "usd"
    ISAACLAB = "isaaclab"
    TAXIM = "taxim"
    TACEX = "tacex"
    PRESSURE_LAW = "pressure-law"


OF_EPISODES = (Format.LEROBOT, Format.HDF5, Format.ROSBAG2, Format.WEBDATASET, Format.ZARR)
"""Formats of what a rig recorded or a sweep computed; the latter is a table already."""
OF_CALIBRATIONS = (Format.ISAACLAB, Format.TAXIM, Format.TACEX)

WRITERS: Mapping[Format, tuple[str, str]] = {
    Format.CSV: ("csv_files", "write_csv"),
    Format.LEROBOT: ("lerobot_hdf5_zarr", "write_lerobot"),
    Format.HDF5: ("lerobot_hdf5_zarr", "write_hdf5"),
    Format.ROSBAG2: ("ros_bag", "write_bag"),
    Format.WEBDATASET: ("lerobot_hdf5_zarr", "write_webdataset"),
    Format.ZARR: ("lerobot_hdf5_zarr", "write_zarr"),
    Format.VTU: ("paraview", "write_vtu"),
    Format.USD: ("usd", "write_usd"),
    Format.ISAACLAB: ("taxim", "write_isaaclab"),
    Format.TAXIM: ("taxim", "write_taxim"),
    Format.TACEX: ("taxim", "write_taxim"),
    Format.PRESSURE_LAW: ("pressure_law", "write_pressure_law"),
}
"""Of each format its module, and what writes it: others are not even loaded."""

_LEAST_BYTES = 1_000_000
"""With less free space, an error of a library is taken for a full disk."""


def export(
    source: Path,
    out: Path,
    form: Format,
    *,
    sensor: str = "gelsight-mini",
    background: Path | None = None,
) -> None:
    """Write a source in a format; what fails leaves no folder behind.

    Args:
        sensor: Of a calibration.
        background: Its no-contact frame.

    Raises:
        RecordError: The source is damaged or no such thing, or ``out`` exists or cannot be written.
        ConfigError: A library is not there.
    """
    # The command line offers the formats; what they bring is not even loaded for that.
    from tacauchy_rig.app.exporting.episode_and_import_toml import episodes_of  # noqa: PLC0415
    from tacauchy_rig.core.store.run_store import RunStore  # noqa: PLC0415

    is_data_set = (source / INDEX).is_file()
    if is_data_set and form not in OF_EPISODES:
        raise RecordError(
            f"{source}: --to {form} takes no data set of a sweep",
            remedy=f"take one of {', '.join(OF_EPISODES)}, or read {INDEX} as the table that it is",
        )
    module, name = WRITERS[form]
    write = getattr(import_module(f"tacauchy_rig.app.exporting.{module}"), name)
    with _new_folder(out) as folder:
        if form in OF_CALIBRATIONS:
            write(source, folder, sensor=sensor, background=background)
        elif form not in OF_EPISODES:
            write(source, folder)
        elif is_data_set:
            from tacauchy_rig.app.exporting.sweep_presses import presses_of  # noqa: PLC0415 - sweeps only

            write(presses_of(source), folder, None)
        else:
            store = RunStore.open(source)
            write(episodes_of(store), folder, store)


@contextmanager
def _new_folder(out: Path) -> Iterator[Path]:
    """Make a folder that gets its name when all of it is written."""
    if out.exists():
        raise RecordError(f"{out}: exists already", remedy="name a new folder to export to")
    folder = out.with_name(f".{out.name}.partial")
    shutil.rmtree(folder, ignore_errors=True)
    try:
        folder.mkdir(parents=True)
        yield folder
        folder.rename(out)
    except OSError as error:
        raise write_error(Path(error.filename or out), error) from error
    except Exception as error:
        if isinstance(error, RigError) or free_bytes(folder) > _LEAST_BYTES:
            raise
        full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))  # libraries raise errors of theirs
        raise write_error(out, full) from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)
