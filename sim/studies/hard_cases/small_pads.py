"""What the hard cases share: small pads that are coarse, deterministic and quick."""

from typing import Any

import numpy as np

from sim.contact.surface_and_grip import ContactOptions, Grip, State
from sim.material.laws.law_and_lame import law
from sim.mesh.brick_refinement import kuhn_tets
from sim.mesh.cached_tet_mesh import TetMesh, oriented
from sim.mesh.elements import ElementOrder
from sim.mesh.mirror_symmetry import MirrorSymmetry
from sim.mesh.revolved_mesh import Grading, revolved_mesh
from sim.scene.indenter import Cylinder, Indenter, Sphere
from sim.scene.material import LawName
from sim.scene.pad import BoxPad, DiscPad, ParametricPad
from sim.solve.model import Model
from sim.solve.path_point import PathPoint
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.tables import Table

Measured = dict[str, float | int | bool | str]
"""What a case has measured, units in the names."""


def numbers_of(table: Table) -> Measured:
    """Return the numbers of a table that another study has measured, each with its row's words."""
    measured = Measured()
    for row in table.rows:
        words = ", ".join(cell for cell in row if isinstance(cell, str))
        words = words or f"{table.columns[0]} {row[0]}"
        numbers = zip(table.columns, row, strict=True)
        measured |= {f"{words}: {name}": n for name, n in numbers if isinstance(n, float | int)}
    return measured


HEIGHT_M = 4e-3
YOUNG_PA = 4e5
POISSON = 0.48
BARRIER_M = 2e-6
DENSITY_KG_M3 = 1070.0

DOMED = BoxPad(
    size_x_m=20e-3, size_y_m=24e-3, height_m=HEIGHT_M, dome_radius_x_m=0.1, dome_radius_y_m=0.2
)
DISC = DiscPad(radius_m=10e-3, height_m=HEIGHT_M)

PUNCH = Cylinder(diameter_m=5e-3, fillet_m=0.2e-3)
BALL = Sphere(diameter_m=8e-3)


def pad_model(
    mesh: TetMesh,
    *,
    order: ElementOrder = ElementOrder.P2,
    young_pa: float = YOUNG_PA,
    poisson: float = POISSON,
    law_name: LawName = LawName.STABLE_NEO_HOOKEAN,
    contact_options: ContactOptions | None = None,
    **contact: Any,
) -> Model:
    """Set up a mesh with the gel's usual material; ``contact`` may name single options instead."""
    return Model(
        mesh,
        order=order,
        law=law(law_name),
        young_pa=young_pa,
        poisson=poisson,
        contact_options=contact_options or ContactOptions(**{"distance_m": BARRIER_M, **contact}),
    )


def round_mesh(
    *,
    pad: ParametricPad = DISC,
    start_m: float = 2.3e-3,
    end_m: float = 2.5e-3,
    size_m: float = 0.4e-3,
    growth: float = 2.0,
    sector_count: int = 8,
    symmetric: bool = True,
) -> TetMesh:
    """Return a coarse mesh revolved about the z axis, fine between two radii."""
    grading = Grading(start_m=start_m, end_m=end_m, size_m=size_m, growth=growth)
    terms: dict[str, Any] = {"centre_m": (0.0, 0.0), "sector_count": sector_count, "name": "hard"}
    return revolved_mesh(pad, grading, symmetry=None if symmetric else MirrorSymmetry(), **terms)


def brick_mesh(
    cells: tuple[int, int, int], *, jitter: float = 0.0, quarter: bool = False
) -> TetMesh:
    """Cut a box of 12 x 12 x 4 mm into cells and each into six tetrahedra (Kuhn).

    Args:
        jitter: Random shift of the interior nodes, in cell sizes, always the same for a mesh.
        quarter: Mesh the quarter at x, y >= 0, whose mirror images are the rest; cells are the
            quarter's.
    """
    width = 6e-3 if quarter else 12e-3
    axes = [np.linspace(0.0, 1.0, count + 1) for count in cells]
    shares = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    if jitter:
        inner = np.all((shares > 1e-9) & (shares < 1.0 - 1e-9), axis=1)
        noise = np.random.default_rng(20).uniform(-jitter, jitter, size=shares.shape)
        shares = shares + np.where(inner[:, None], noise / np.array(cells), 0.0)
    origin = np.zeros(3) if quarter else np.array([0.5, 0.5, 0.0])
    vertices: FloatArray = (shares - origin) * (width, width, HEIGHT_M)
    mesh = TetMesh(
        vertices=vertices,
        tets=kuhn_tets(cells),
        name=f"box, {cells[0]}x{cells[1]}x{cells[2]}",
        symmetry=MirrorSymmetry(mirror_x=quarter, mirror_y=quarter),
    )
    return oriented(mesh)


def balance_relative(model: Model, point: PathPoint) -> float:
    """Return |indenter's force less base reaction| over the force."""
    clamp = point.equilibrium.elastic_gradient[model.clamped].sum(axis=0)
    away = point.force_n - model.mesh.symmetry.whole_force(clamp)
    return float(np.linalg.norm(away) / np.linalg.norm(point.force_n))


def grip_of(point: PathPoint) -> Grip:
    """Return what tangential contact remembers."""
    if point.state.grip is None:
        raise ValueError("a press without friction has no grip")
    return point.state.grip


def stored_j(model: Model, indenter: Indenter, state: State) -> float:
    """Return what gel and contact of the modelled part have stored [J]."""
    contact = model.surface.energy(state.positions, indenter, state)
    return model.gel.energy(state.positions)[0] + contact
