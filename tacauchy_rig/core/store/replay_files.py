"""A replayed trial's arrays and image on disk."""

from __future__ import annotations

import io
import zipfile
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
_REMEDY = "replay the run again: `tacauchy-rig replay RUN`"


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayFields:
    """What the simulator leaves of one trial."""

    # Named arrays of the mechanics (SI), into ``fields.npz``
    fields: dict[str, NDArray[Any]] = field(default_factory=dict)
    # Named arrays of the deformed surface seen by the camera (SI), into ``height.npz``
    height: dict[str, NDArray[Any]] = field(default_factory=dict)
    # Rendered tactile image, RGB uint8, shape [height, width, 3], into ``image.png``
    image: NDArray[np.uint8] | None = None
    # The deformed surface for ParaView, the whole file, into ``surface.vtu``
    surface_vtu: bytes | None = None
    # Small images and maps on the way to the force, into ``passed.npz``; empty where the replay is
    # from before they were kept
    passed: dict[str, NDArray[Any]] = field(default_factory=dict)


_ARRAYS = ("fields", "height", "passed")


def write_fields(folder: Path, fields: ReplayFields) -> None:
    """Write one trial's arrays and image, each file whole or not at all."""
    for name in _ARRAYS:
        if arrays := getattr(fields, name):
            write_atomically(folder / f"{name}.npz", pack_arrays(arrays))
    if fields.image is not None:
        write_atomically(folder / "image.png", encode_png(fields.image))
    if fields.surface_vtu is not None:
        write_atomically(folder / "surface.vtu", fields.surface_vtu)


def read_fields(folder: Path) -> ReplayFields:
    """Read what there is of one trial."""
    if not folder.is_dir():
        raise RecordError(f"{folder}: this trial was not replayed", remedy=_REMEDY)
    path, surface = folder / "image.png", folder / "surface.vtu"
    image = decode_rgb(read_bytes(path, what="the image")) if path.exists() else None
    if image is None and path.exists():
        raise RecordError(f"{path}: not a readable PNG", remedy=_REMEDY)
    return ReplayFields(
        image=image,
        surface_vtu=read_bytes(surface, what="the surface") if surface.exists() else None,
        **{name: unpack_arrays(folder / f"{name}.npz") for name in _ARRAYS},
    )


def pack_arrays(arrays: dict[str, NDArray[Any]]) -> bytes:
    """Return named arrays as the bytes of an ``.npz`` file."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    return buffer.getvalue()


def unpack_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Read named arrays; none where there is no file."""
    if not path.exists():
        return {}
    content = io.BytesIO(read_bytes(path, what="the fields"))
    try:
        with zipfile.ZipFile(content) as archive:
            size = sum(each.file_size for each in archive.infolist())
        if size > _MAX_UNPACKED_BYTES:
            raise ValueError(f"its arrays take {size / 1e6:.0f} MB")
        with np.load(content, allow_pickle=False) as data:
            return dict(data)
    except Exception as error:  # NumPy, zipfile and zlib raise a dozen kinds of a foreign file
        raise RecordError(f"{path}: damaged: {error}", remedy=_REMEDY) from error
