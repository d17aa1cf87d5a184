"""Tetrahedral meshes of a pad: the type, its checks, and the files of meshes."""

import hashlib
import os
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from io import BytesIO
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from sim.mesh.elements import FACES, doubled_areas
from sim.mesh.mirror_symmetry import MirrorSymmetry
from sim.scene.triangle_surface import renumbered, unit
from tacauchy_rig.core.arrays import FloatArray, IntArray
from tacauchy_rig.core.errors import ConfigError, RecordError
from tacauchy_rig.core.store.atomic_write import write_atomically


@dataclass(frozen=True, slots=True, kw_only=True)
class TetMesh:
    """Corner nodes and positively oriented tetrahedra of a pad."""

    vertices: FloatArray  # positions [m], shape [vertex_count, 3]; the clamped base lies at z = 0
    tets: IntArray  # shape [tet_count, 4]
    name: str
    # The symmetry by which these tetrahedra stand for the whole pad
    symmetry: MirrorSymmetry = field(default_factory=MirrorSymmetry)
    # Layer of each tetrahedron from the base upwards, shape [tet_count]; None where the mesh was
    # made for a gel of one material
    layers: IntArray | None = None
    axis_m: tuple[float, float] | None = None  # axis of revolution, x and y [m]; None for none

    @property
    def labels(self) -> IntArray:
        """The layer of every tetrahedron; zero in a gel of one material."""
        return np.zeros(len(self.tets), dtype=np.int32) if self.layers is None else self.layers

    @property
    def content_hash(self) -> str:
        """First 16 hex digits of the SHA-256 of vertices, tetrahedra and their layers."""
        parts = [self.vertices, self.tets, *([] if self.layers is None else [self.layers])]
        whole = b"".join(np.ascontiguousarray(part).tobytes() for part in parts)
        return hashlib.sha256(whole).hexdigest()[:16]


def tet_volumes(vertices: FloatArray, tets: IntArray) -> FloatArray:
    """Return the volume of every tetrahedron [m^3], negative for one that is turned over."""
    corners = vertices[tets]
    return np.asarray(np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6.0)


def oriented(mesh: TetMesh) -> TetMesh:
    """Return a mesh with unused vertices dropped and every tetrahedron turned positive."""
    used, tets = renumbered(mesh.tets)
    vertices = np.ascontiguousarray(mesh.vertices[used], dtype=np.float64)
    negative = tet_volumes(vertices, tets) < 0.0
    tets[negative] = tets[negative][:, [0, 2, 1, 3]]
    return replace(mesh, vertices=vertices, tets=tets)


def refuse_flat(mesh: TetMesh, least_rad: float) -> None:
    """Refuse a mesh with a smaller angle between faces of a tetrahedron than this [rad]."""
    found, asked = smallest_dihedral_deg(mesh), float(np.degrees(least_rad))
    if found < asked:
        raise ConfigError(
            f"mesh {mesh.name} has an angle of {found:.3g} deg between faces of a tetrahedron, "
            f"less than the {asked:.3g} deg asked for",
            remedy="lower stop_energy, which makes another mesh, or ask for less",
        )


def smallest_dihedral_deg(mesh: TetMesh) -> float:
    """Return the smallest angle between two faces of a tetrahedron [deg]."""
    normals = [unit(doubled_areas(mesh.vertices, mesh.tets[:, list(face)])) for face in FACES]
    cosines = [-np.einsum("ij,ij->i", one, other) for one, other in combinations(normals, 2)]
    return float(np.degrees(np.arccos(np.clip(np.max(cosines), -1.0, 1.0))))


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
    shipped = Path(__file__).with_name("shipped") / name
    path = shipped if shipped.is_file() else cache_folder() / name
    if not path.is_file():
        write_mesh(path, make())
    return read_mesh(path)


def read_mesh(path: Path) -> TetMesh:
    """Read a mesh file and check it against its own hash."""
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
    arrays: dict[str, Any] = {"vertices": mesh.vertices, "tets": mesh.tets, "name": mesh.name}
    arrays["content_hash"] = mesh.content_hash
    if mesh.layers is not None:
        arrays["layers"] = mesh.layers
    contents = BytesIO()
    np.savez_compressed(contents, **arrays)
    write_atomically(path, contents.getvalue())
