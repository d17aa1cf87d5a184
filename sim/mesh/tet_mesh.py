"""Tetrahedral meshes of a pad: mirror symmetry, the type, its checks, and the files of meshes."""

import hashlib
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from importlib import resources
from io import BytesIO
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.mesh.elements import FACES
from tacauchy_rig.core.arrays import FloatArray, IntArray
from tacauchy_rig.core.errors import ConfigError, RecordError
from tacauchy_rig.core.store.atomic_write import write_atomically

_SAME_POINT = 1e-9
# The nodes of faces and tetrahedra, linear and quadratic, in the order of their mirror image.
_FLIPPED = {
    3: (0, 2, 1),
    6: (0, 2, 1, 5, 4, 3),
    4: (0, 2, 1, 3),
    10: (0, 2, 1, 3, 6, 5, 4, 7, 9, 8),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class MirrorSymmetry:
    """Which coordinate planes mirror the modelled part."""

    mirror_x: bool = False  # the part lies at x >= 0 and the plane x = 0 mirrors it
    mirror_y: bool = False  # the part lies at y >= 0 and the plane y = 0 mirrors it

    @property
    def copies(self) -> int:
        """How many of the part make the whole."""
        return (2 if self.mirror_x else 1) * (2 if self.mirror_y else 1)

    def on_plane(self, points: FloatArray, size_m: float) -> NDArray[np.bool_]:
        """Return which coordinates a mirror plane holds still, shape [point_count, 3]."""
        held = np.zeros(points.shape, dtype=np.bool_)
        for axis, mirrored in enumerate((self.mirror_x, self.mirror_y)):
            if mirrored:
                held[:, axis] = np.abs(points[:, axis]) <= _SAME_POINT * size_m
        return held

    def whole_force(self, force: FloatArray) -> FloatArray:
        """Return the force on the whole from that on the part, shape [3]."""
        return np.asarray(np.sum([sign * force for sign in self.signs()], axis=0))

    def whole_moment(self, moment: FloatArray) -> FloatArray:
        """Return the moment on the whole from that on the part, shape [3]; it is a pseudovector."""
        return np.asarray(np.sum([sign.prod() * sign * moment for sign in self.signs()], axis=0))

    def signs(self) -> Iterator[FloatArray]:
        """Yield the coordinate signs of each copy, the part itself first, shape [3]."""
        for y, x in product(
            (1.0, -1.0) if self.mirror_y else (1.0,), (1.0, -1.0) if self.mirror_x else (1.0,)
        ):
            yield np.array([x, y, 1.0])


class WholeSurface:
    """The node numbering of the whole surface.

    Args:
        rest: Nodes of the part at rest [m], shape [node_count, 3].

    Attributes:
        sources: Node of the part that each node of the whole is, or mirrors.
        signs: Of its coordinates, shape [whole node_count, 3].
        numbers: Node of the whole that each node of the part is, shape [node_count].
    """

    def __init__(self, symmetry: MirrorSymmetry, rest: FloatArray) -> None:
        self._signs = list(symmetry.signs())
        copies = np.concatenate([rest * sign for sign in self._signs])
        grid = np.round(copies / (_SAME_POINT * max(float(np.abs(rest).max()), 1e-30)))
        _, first, inverse = np.unique(grid + 0.0, axis=0, return_index=True, return_inverse=True)
        copy, self.sources = np.divmod(first, len(rest))
        self.signs = np.array(self._signs)[copy]
        # Node of the whole that each node of every copy is.
        self._numbers = inverse.reshape(len(self._signs), len(rest)).astype(np.int32)
        self.numbers = self._numbers[0]

    def at_nodes(self, values: FloatArray) -> FloatArray:
        """Return numbers, vectors or tensors at the nodes of the whole from those of the part."""
        return _mirrored(values[self.sources], self.signs)

    def at_faces(self, values: FloatArray) -> FloatArray:
        """Return the same of faces or tetrahedra."""
        return np.concatenate([_mirrored(values, sign) for sign in self._signs])

    def nodal_forces(self, values: FloatArray) -> FloatArray:
        """Return nodal forces of the whole: on a mirror plane both sides add."""
        whole = np.zeros((len(self.sources), 3))
        np.add.at(whole, self._numbers, [values * sign for sign in self._signs])
        return whole

    def copies(self, faces: IntArray) -> IntArray:
        """Return the faces of the whole, their nodes in the order of the part's, copy by copy."""
        return np.concatenate([numbers[faces] for numbers in self._numbers])

    def faces(self, faces: IntArray) -> IntArray:
        """Return the faces or tetrahedra of the whole, none of them inside out."""
        flipped = list(_FLIPPED[faces.shape[1]])
        parts = [
            numbers[faces if sign.prod() > 0.0 else faces[:, flipped]]
            for numbers, sign in zip(self._numbers, self._signs, strict=True)
        ]
        return np.concatenate(parts)


def _mirrored(values: FloatArray, signs: FloatArray) -> FloatArray:
    """Return images of numbers [n], vectors [n, 3] or tensors [n, 3, 3]; signs [n, 3] or [3]."""
    if values.ndim == 1:
        return values
    if values.ndim == 2:
        return values * signs
    return values * signs[..., None] * signs[..., None, :]


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
    # Axis about which it was revolved, x and y [m]; None where it was not
    axis_m: tuple[float, float] | None = None

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
    used, inverse = np.unique(mesh.tets, return_inverse=True)
    tets = inverse.reshape(-1, 4).astype(np.int32)
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
    corners, normals = mesh.vertices[mesh.tets], []
    for a, b, c in FACES:
        n = np.cross(corners[:, b] - corners[:, a], corners[:, c] - corners[:, a])
        normals.append(n / np.linalg.norm(n, axis=1, keepdims=True))
    cosines = [
        -np.einsum("ij,ij->i", normals[i], normals[j]) for i in range(4) for j in range(i + 1, 4)
    ]
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
    shipped = resources.files("sim.mesh.shipped").joinpath(name)
    if shipped.is_file():
        with resources.as_file(shipped) as path:
            return read_mesh(path)
    path = cache_folder() / name
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
    layers: dict[str, Any] = {} if mesh.layers is None else {"layers": mesh.layers}
    contents = BytesIO()
    np.savez_compressed(
        contents,
        vertices=mesh.vertices,
        tets=mesh.tets,
        name=np.array(mesh.name),
        content_hash=np.array(mesh.content_hash),
        **layers,
    )
    write_atomically(path, contents.getvalue())
