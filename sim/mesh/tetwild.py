"""Fills pads by fTetWild: their closed surfaces, and the paper's sizing field of section III-A."""

import importlib
import math
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sim.mesh.cached_tet_mesh import TetMesh, oriented
from sim.mesh.revolved_mesh import triangulated
from sim.scene.indenter import ring_walls
from sim.scene.pad import Pad, ParametricPad, SurfacePad
from tacauchy_rig.core.arrays import FloatArray, IntArray
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.time_limit_and_progress import check_time, time_left_s

# The sizing field's grid reaches so far beyond the pad, in half extents, and has so many points.
_GRID_REACH = 1.1
_GRID_COUNTS = (33, 33, 41)
# What lies within so many envelopes of the base or of an interface is moved onto it.
_SNAP_ENVELOPES = 2.0
# Inner points of a parametric pad's top keep this share of the spacing from its outline.
_INNER_SHARE = 0.4


@dataclass(frozen=True, slots=True, kw_only=True)
class WildSizing:
    """Settings of fTetWild and of the paper's sizing field.

    The paper does not say what its planar half-extent is where a pad is not square; here the radius
    is taken relative to the half-extent of each direction, an ellipse.
    """

    contact_share: float = 0.15  # the contact surface is this share of the thickness
    fine_share: float = 0.40  # r_c: radius of the fine region over the half-extent
    band_share: float = 0.20  # r_t: width of the cosine band over the half-extent
    fine_m: float = 0.8e-3  # l_c, edge length in the fine region, and of a parametric surface [m]
    coarse_m: float = 3.2e-3  # l_g, edge length elsewhere [m]
    envelope_share: float = 1e-3  # epsilon over the bounding box's diagonal
    stop_energy: float = 10.0


def wild_mesh(
    pad: Pad,
    sizing: WildSizing,
    *,
    name: str,
    interface_shares: tuple[float, ...] = (),
    graded: bool = True,
) -> TetMesh:
    """Fill a pad with tetrahedra as the paper does; another run gives another mesh.

    fTetWild looks up a sizing field only where its uniform mesh has vertices, and in between goes
    by those: what is much finer than the coarse edge length, as a rim is, comes out too coarse.

    Args:
        interface_shares: Rising shares of the local height at which layers meet.
        graded: By the sizing field; if not, all edges are about as long as the coarse ones.

    Raises:
        ConfigError: A layer is too thin for fTetWild's envelope, or the mesh ran across an
            interface.
    """
    surface = pad_surface(pad, spacing_m=sizing.fine_m, interface_shares=interface_shares)
    snap = _SNAP_ENVELOPES * sizing.envelope_share * float(np.linalg.norm(np.ptp(surface[0], 0)))
    thin = min(np.diff([0.0, *interface_shares, 1.0])) * pad.height_m
    if interface_shares and thin < 2.0 * snap:
        raise ConfigError(
            f"a layer of {thin * 1e6:.3g} um is too thin for fTetWild, which moves surfaces "
            f"by up to {0.5 * snap * 1e6:.3g} um",
            remedy="use another preset, or a thicker layer",
        )
    background = _background(pad, sizing) if graded else {}
    vertices, tets = _tetrahedralized(
        vertices=surface[0],
        faces=surface[1],
        edge_length_abs=sizing.coarse_m,
        epsilon=sizing.envelope_share,
        stop_energy=sizing.stop_energy,
        optimize=True,
        num_threads=1,
        **background,
    )
    vertices[vertices[:, 2] < snap, 2] = 0.0
    layers = None
    if interface_shares:
        layers = _snapped_layers(vertices, tets, pad, interface_shares, snap)
    return oriented(TetMesh(vertices=vertices, tets=tets, name=name, layers=layers))


# It would hold Python's lock until it has finished, and drops a file of its own where it runs.
_MESHER = """
import numpy, pytetwild
given = {name: each if each.ndim else each.item() for name, each in numpy.load("given.npz").items()}
vertices, tets = pytetwild.tetrahedralize(given.pop("vertices"), given.pop("faces"), **given)
numpy.savez("made.npz", vertices=vertices, tets=tets)
"""


def _tetrahedralized(**given: Any) -> tuple[FloatArray, IntArray]:
    """Return vertices [m] and tetrahedra that fTetWild makes in a process of its own."""
    left_s = time_left_s()
    with tempfile.TemporaryDirectory() as aside:
        np.savez(Path(aside) / "given.npz", **given)
        try:
            subprocess.run(
                [sys.executable, "-c", _MESHER],
                cwd=aside,
                timeout=left_s if math.isfinite(left_s) else None,
                check=True,
                capture_output=True,
                text=True,
            )
        except subprocess.TimeoutExpired:
            check_time()
            raise
        except subprocess.CalledProcessError as error:
            said = (error.stderr.strip() or f"it ended with {error.returncode}").splitlines()[-1]
            raise ConfigError(
                f"fTetWild cannot fill the pad: {said}", remedy="use other mesh settings (--mesh)"
            ) from error
        with np.load(Path(aside) / "made.npz") as made:
            return np.asarray(made["vertices"], dtype=np.float64), made["tets"]


def _background(pad: Pad, sizing: WildSizing) -> dict[str, Any]:
    """Return tetrahedra with edge lengths at their corners, between which fTetWild interpolates."""
    half = np.array([*pad.half_extents(), 0.5 * pad.height_m])
    axes = [
        np.linspace(-_GRID_REACH, _GRID_REACH, count) * h
        for h, count in zip(half, _GRID_COUNTS, strict=True)
    ]
    pyvista = importlib.import_module("pyvista")
    grid = pyvista.RectilinearGrid(axes[0], axes[1], axes[2] + half[2])
    cells = grid.to_tetrahedra(6, pass_data=False).cells.reshape(-1, 5)
    points = np.asarray(grid.points)  # in double precision, which the cut drops
    return {
        "bg_vertices": points,
        "bg_tets": cells[:, [1, 2, 4, 3]].astype(np.int32),
        "bg_values": edge_length_at(points, pad, sizing),
    }


def _snapped_layers(
    vertices: FloatArray, tets: IntArray, pad: Pad, shares: tuple[float, ...], snap_m: float
) -> IntArray:
    """Move the vertices near an interface onto it; return each tetrahedron's layer."""
    heights = pad.height_at(vertices[:, 0], vertices[:, 1])
    layers = np.zeros(len(tets), dtype=np.int32)
    for share in shares:
        near = np.abs(vertices[:, 2] - share * heights) < snap_m
        vertices[near, 2] = share * heights[near]
        side = np.sign(np.where(near, 0.0, vertices[:, 2] - share * heights))[tets]
        if np.any((side.min(axis=1) < 0.0) == (side.max(axis=1) > 0.0)):
            raise ConfigError(
                f"fTetWild's mesh runs across the interface at {share:.4g} of the height",
                remedy="run again, which gives another mesh, or use another preset",
            )
        layers += side.max(axis=1) > 0.0
    return layers


def edge_length_at(points: FloatArray, pad: Pad, sizing: WildSizing) -> FloatArray:
    """Return the sizing field at points [count, 3] of a pad [m]."""
    half = pad.half_extents()
    radius = np.hypot(points[:, 0] / half[0], points[:, 1] / half[1])
    share = np.clip((radius - sizing.fine_share) / sizing.band_share, 0.0, 1.0)
    weight = 0.5 * (1.0 - np.cos(np.pi * share))
    edge = sizing.fine_m + weight * (sizing.coarse_m - sizing.fine_m)
    near = points[:, 2] >= (1.0 - sizing.contact_share) * pad.height_m
    return np.where(near, edge, sizing.coarse_m)


def pad_surface(
    pad: Pad, *, spacing_m: float, interface_shares: tuple[float, ...] = ()
) -> tuple[FloatArray, IntArray]:
    """Triangulate a pad's surface, outward normals, and the interfaces of its layers.

    A pad from a file keeps its triangles; of another, points of the top lie about a spacing [m]
    apart. Sheets cut it at shares of the local height.
    """
    if isinstance(pad, SurfacePad):
        if interface_shares:
            raise ConfigError(
                f"pad {pad.name} comes from a file, and the layers of such a pad are not meshed",
                remedy="give one material, or state the pad as a box or a disc",
            )
        return pad.surface.vertices, pad.surface.faces
    plan, rim_count = _plan(pad, spacing_m)
    heights, shares = pad.height_at(plan[:, 0], plan[:, 1]), (1.0, 0.0, *interface_shares)
    sheets = [np.column_stack([plan, share * heights]) for share in shares]
    triangles = triangulated(plan)
    walls = ring_walls(np.arange(rim_count) + np.array([[len(plan)], [0]]))
    cuts = [triangles + number * len(plan) for number in range(2, len(sheets))]
    faces = np.concatenate([triangles, triangles[:, ::-1] + len(plan), walls, *cuts])
    return np.concatenate(sheets), faces.astype(np.int32)


def _plan(pad: ParametricPad, spacing_m: float) -> tuple[FloatArray, int]:
    """Return points seen from above, the outline first and counter-clockwise."""
    half = np.array(pad.half_extents())
    count = max(24, round(2.0 * np.pi * half.max() / spacing_m))
    angles, reach = pad.sectors(np.zeros(2), count, start_rad=0.0, end_rad=2.0 * np.pi)
    outline = (reach * np.array([np.cos(angles), np.sin(angles)])).T[:-1]
    axes = [np.linspace(-h, h, max(3, round(2.0 * h / spacing_m) + 1)) for h in half]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    inner = grid[pad.distance_to_outline(grid) > _INNER_SHARE * spacing_m]
    return np.concatenate([outline, inner]), len(outline)
