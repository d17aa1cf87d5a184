"""A replayed trial's arrays and image on disk."""

from __future__ import annotations

import io
import zipfile
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.rgb import decode_rgb, encode_png
from tacauchy_rig.core.store.durable import write_atomically
from tacauchy_rig.core.store.run_files import read_bytes

_MAX_UNPACKED_BYTES = 1 << 30
_DAMAGED = (
    ValueError,
    KeyError,
    EOFError,
    OSError,
    RuntimeError,
    SyntaxError,
    zipfile.BadZipFile,
    zlib.error,
)
"""What NumPy and zipfile raise of files that they did not write."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayFields:
    """What the simulator leaves of one trial.

    Attributes:
        fields: Named arrays of the mechanics (SI), into ``fields.npz``.
        height: Named arrays of the deformed surface seen by the camera (SI), into ``height.npz``.
        image: Rendered tactile image, RGB uint8, shape [height, width, 3], into ``image.png``.
        surface_vtu: The deformed surface for ParaView, the whole file, into ``surface.vtu``.
        passed: Small images and maps on the way to the force, into ``passed.npz``; empty where
            the replay is from before they were kept.
    """

    fields: dict[str, NDArray[Any]] = field(default_factory=dict)
    height: dict[str, NDArray[Any]] = field(default_factory=dict)
    image: NDArray[np.uint8] | None = None
    surface_vtu: bytes | None = None
    passed: dict[str, NDArray[Any]] = field(default_factory=dict)


def write_fields(folder: Path, fields: ReplayFields) -> None:
    """Write one trial's arrays and image, each file whole or not at all.

    Raises:
        RecordError: The disk is full or gone.
    """
    if fields.fields:
        write_atomically(folder / "fields.npz", pack_arrays(fields.fields))
    if fields.height:
        write_atomically(folder / "height.npz", pack_arrays(fields.height))
    if fields.image is not None:
        write_atomically(folder / "image.png", encode_png(fields.image))
    if fields.surface_vtu is not None:
        write_atomically(folder / "surface.vtu", fields.surface_vtu)
    if fields.passed:
        write_atomically(folder / "passed.npz", pack_arrays(fields.passed))


def read_fields(folder: Path) -> ReplayFields:
    """Read what there is of one trial.

    Raises:
        RecordError: The folder is missing, or a file in it is damaged.
    """
    if not folder.is_dir():
        raise RecordError(
            f"{folder}: this trial was not replayed",
            remedy="replay the run again: `tacauchy-rig replay RUN`",
        )
    image, surface = folder / "image.png", folder / "surface.vtu"
    return ReplayFields(
        fields=unpack_arrays(folder / "fields.npz"),
        height=unpack_arrays(folder / "height.npz"),
        image=_read_png(image) if image.exists() else None,
        surface_vtu=read_bytes(surface, what="the surface") if surface.exists() else None,
        passed=unpack_arrays(folder / "passed.npz"),
    )


def _read_png(path: Path) -> NDArray[np.uint8]:
    """Return a PNG as RGB, shape [height, width, 3].

    Raises:
        RecordError: Missing or damaged.
    """
    image = decode_rgb(read_bytes(path, what="the image"))
    if image is None:
        raise RecordError(f"{path}: not a readable PNG", remedy="replay the run again")
    return image


def pack_arrays(arrays: dict[str, NDArray[Any]]) -> bytes:
    """Return named arrays as the bytes of an ``.npz`` file."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    return buffer.getvalue()


def _check_size(content: io.BytesIO) -> None:
    """Refuse arrays that would take far more memory than the program ever writes.

    Raises:
        ValueError: They would.
        zipfile.BadZipFile: It holds no arrays.
    """
    with zipfile.ZipFile(content) as archive:
        size = sum(each.file_size for each in archive.infolist())
    if size > _MAX_UNPACKED_BYTES:
        raise ValueError(f"its arrays take {size / 1e6:.0f} MB")


def unpack_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Read named arrays; none where there is no file.

    Raises:
        RecordError: It is damaged.
    """
    if not path.exists():
        return {}
    content = io.BytesIO(read_bytes(path, what="the fields"))
    try:
        _check_size(content)
        with np.load(content, allow_pickle=False) as data:
            return dict(data)
    except (*_DAMAGED, MemoryError) as error:
        raise RecordError(
            f"{path}: damaged: {error}", remedy="replay the run again: `tacauchy-rig replay RUN`"
        ) from error
