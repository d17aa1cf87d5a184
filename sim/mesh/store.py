"""Meshes kept by content: shipped with the program, or made once in the user's cache folder."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from sim.mesh.tet_mesh import TetMesh
from tacauchy_rig.core.errors import RecordError


def mesh_key(*settings: object) -> str:
    """Return 12 hex digits that name a mesh by what it was made from."""
    return hashlib.sha256(repr(settings).encode()).hexdigest()[:12]


def cache_folder() -> Path:
    """Return where meshes made on this machine are kept."""
    root = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(root) / "tacauchy-rig" / "meshes"


def stored_mesh(label: str, key: str, make: Callable[[], TetMesh]) -> TetMesh:
    """Return a mesh that was shipped or made before, else make and keep it.

    Raises:
        RecordError: The stored file is damaged.
    """
    name = f"{label}-{key}.npz"
    shipped = resources.files("sim.mesh.shipped").joinpath(name)
    if shipped.is_file():
        with resources.as_file(shipped) as path:
            return read_mesh(path)
    path = cache_folder() / name
    if not path.is_file():
        write_mesh(path, make())
    return read_mesh(path)


def read_mesh(path: Path) -> TetMesh:
    """Read a mesh file and check it against its own hash.

    Raises:
        RecordError: The file is damaged.
    """
    remedy = f"delete {path}; it is made again when it is needed"
    try:
        with np.load(path, allow_pickle=False) as data:
            mesh = TetMesh(
                vertices=data["vertices"],
                tets=data["tets"],
                name=str(data["name"]),
                layers=data.get("layers"),
            )
            stated = str(data["content_hash"])
    except (OSError, ValueError, KeyError) as error:
        raise RecordError(f"mesh {path} cannot be read: {error}", remedy=remedy) from error
    if mesh.content_hash != stated:
        raise RecordError(
            f"mesh {path} is damaged: its hash is {mesh.content_hash}, not {stated}", remedy=remedy
        )
    return mesh


def write_mesh(path: Path, mesh: TetMesh) -> None:
    """Write a mesh file, whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    contents: dict[str, Any] = {
        "vertices": mesh.vertices,
        "tets": mesh.tets,
        "name": np.array(mesh.name),
        "content_hash": np.array(mesh.content_hash),
    }
    if mesh.layers is not None:
        contents["layers"] = mesh.layers
    handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".npz")
    with os.fdopen(handle, "wb") as file:
        np.savez_compressed(file, **contents)
    Path(temporary).chmod(0o644)
    Path(temporary).replace(path)
