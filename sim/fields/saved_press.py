"""What a press leaves behind: the surface for the optics, arrays for a npz file, a VTU file."""

import importlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from sim.fields.pressure_and_shear import surface_traction
from sim.fields.stress import cauchy_stress, components, surface_stress
from sim.mesh.elements import doubled_areas, linear_facets
from sim.mesh.mirror_symmetry import WholeSurface
from sim.scene.indenter import Indenter, MeshIndenter, TurnedIndenter, grown, turned_triangles
from sim.scene.triangle_surface import renumbered
from sim.solve.loading_path import LoadingPath
from sim.solve.model import Model
from sim.solve.path_point import PathPoint
from tacauchy_rig.core.arrays import AnyArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True, kw_only=True)
class TopSurface:
    """The gel's contact surface at rest, and how its nodes follow those of a model."""

    rest: FloatArray  # nodes at rest [m], shape [node_count, 3]
    # Counter-clockwise seen from +z: linear ones, shape [face_count, 3], or quadratic ones, shape
    # [face_count, 6], corners 0, 1, 2, then the nodes on the edges 01, 12, 20
    faces: IntArray
    sources: IntArray  # node of the model that each node is, or mirrors
    signs: FloatArray  # of its coordinates, shape [node_count, 3]
    # Axis about which the mesh was revolved, x and y [m]; None where it was not
    mesh_axis_m: tuple[float, float] | None = None

    def of(self, nodes: FloatArray) -> FloatArray:
        """Return its nodes from those of the model, such as positions [m], [node_count, 3]."""
        return np.asarray(nodes[self.sources] * self.signs)


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceState:
    """The gel's contact surface at rest and deformed, and the indenter in it.

    The frame is the pad's: x, y centred on the pad, z = 0 at the clamped base, +z towards the
    indenter. Only the top surface is held, not the side walls or the base. Of a quadratic
    element (P2) the mid-edge nodes are nodes like any other.
    """

    positions_rest: FloatArray  # nodes at rest [m], shape [node_count, 3]
    positions: FloatArray  # the same nodes deformed [m], shape [node_count, 3]
    faces: IntArray  # as ``TopSurface``; quadratic ones straight at rest, parabolic when deformed
    # The rigid body, or with a wide barrier what lies within d_hat of it; its ``lower_surface(x,
    # y)`` is the height above its own tip
    indenter: Indenter
    # Its tip [m], shape [3]: no point of the gel lies above ``indenter_position[2] +
    # lower_surface(x - indenter_position[0], ...)``, unless by a part of a wide barrier's d_hat
    # where it is pressed hard
    indenter_position: FloatArray
    indenter_rotation: FloatArray  # indenter frame to pad frame, shape [3, 3]
    # How far off the indenter the gel lies where it touches [m]: the contact distance d_hat, while
    # the indenter is the body itself
    standoff_m: float = 0.0
    mesh_axis_m: tuple[float, float] | None = None  # as ``TopSurface`` has it

    @property
    def top(self) -> TopSurface:
        """The surface at rest, of which this one is its own model."""
        return TopSurface(
            rest=self.positions_rest,
            faces=self.faces,
            sources=np.arange(len(self.positions_rest), dtype=np.int32),
            signs=np.ones_like(self.positions_rest),
            mesh_axis_m=self.mesh_axis_m,
        )

    def indenter_height(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the height of the indenter's underside over x, y of the pad [m], inf beside it."""
        body = TurnedIndenter(indenter=self.indenter, rotation=self.indenter_rotation)
        tip = self.indenter_position
        return np.asarray(body.lower_surface(x - tip[0], y - tip[1]) + tip[2])


@dataclass(frozen=True, slots=True, kw_only=True)
class IntermediateState:
    """The surface at one force along a press."""

    force_n: float
    depth_m: float
    surface: SurfaceState
    pressure_pa: FloatArray  # contact pressure at the surface's nodes, shape [node_count]


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialFields:
    """Fields of one equilibrium, units in the names."""

    shape: dict[str, AnyArray]  # nodes and faces of the deformed surface, and the indenter's tip
    at_nodes: dict[str, FloatArray]
    at_faces: dict[str, FloatArray]
    surface: SurfaceState  # the deformed contact surface, for the optics
    # Along the loading path and at its end, the smallest force first; empty where not asked for
    intermediate: tuple[IntermediateState, ...] = ()

    @property
    def arrays(self) -> dict[str, AnyArray]:
        """All of them, for ``fields.npz``."""
        return {**self.shape, **self.at_nodes, **self.at_faces}

    @property
    def surface_vtu(self) -> bytes:
        """The whole deformed surface with stress and contact as a .vtu file, for ParaView."""
        return vtu(self.shape["faces"], self.shape["node_m"], self.at_nodes, self.at_faces)


def trial_fields(path: LoadingPath, point: PathPoint) -> TrialFields:
    """Extract stress, contact and surface from an equilibrium.

    By Algorithm 1 of the paper, from sigma n on faces: ``traction_pa`` (t), ``normal_traction_pa``
    (p_n) and ``tangential_traction_pa`` (t_tau). By its Algorithm 2, from contact at nodes:
    ``contact_force_n`` (f_k), its normal and tangential parts, and recovered pressure and shear.
    Tensors are xx, yy, zz, xy, yz, xz. Errors are estimates: of the faces' stress what the
    continuous stress is apart from it, of pressure and shear what the continuous stress's are.
    """
    model = path.model
    tensors = cauchy_stress(model, point.state.positions)
    stress = surface_stress(model, point.state.positions)
    # Nodal forces of quadratic faces are the virtual work's: a corner's share of an even pressure
    # is small, and f_k over an area A_k is none. Pressure and shear are therefore recovered.
    forces = -model.surface.scatter(point.equilibrium.contact.forces)
    recovered = surface_traction(model, point)
    normal = np.einsum("ni,ni->n", forces, recovered.normals)[:, None] * recovered.normals
    apart = np.einsum("nij,nj->ni", tensors.nodes_pa, recovered.normals) - recovered.traction_pa
    apart[recovered.pressure_pa == 0.0] = 0.0
    across = np.einsum("ni,ni->n", apart, recovered.normals)
    along = np.linalg.norm(apart - across[:, None] * recovered.normals, axis=1)
    nodes, faces = renumbered(model.faces)
    whole = WholeSurface(model.mesh.symmetry, model.nodes[nodes])
    parents = model.face_parents
    return TrialFields(
        shape={
            "node_rest_m": whole.at_nodes(model.nodes[nodes]),
            "node_m": whole.at_nodes(point.state.positions[nodes]),
            "faces": whole.faces(faces),
            "face_area_m2": whole.at_faces(stress.areas_m2),
            "face_normal": whole.at_faces(stress.normals),
            "indenter_tip_m": point.state.tip,
        },
        at_nodes={
            "displacement_m": whole.at_nodes((point.state.positions - model.nodes)[nodes]),
            "contact_force_n": whole.nodal_forces(forces[nodes]),
            "contact_normal_force_n": whole.nodal_forces(normal[nodes]),
            "contact_tangential_force_n": whole.nodal_forces((forces - normal)[nodes]),
            "contact_pressure_pa": whole.at_nodes(recovered.pressure_pa[nodes]),
            "contact_pressure_error_pa": whole.at_nodes(np.abs(across)[nodes]),
            "contact_shear_pa": whole.at_nodes(recovered.tangential_pa[nodes]),
            "contact_shear_error_pa": whole.at_nodes(along[nodes]),
            "cauchy_stress_pa": components(whole.at_nodes(tensors.nodes_pa[nodes])),
        },
        at_faces={
            "traction_pa": whole.at_faces(stress.traction_pa),
            "normal_traction_pa": whole.at_faces(stress.normal_pa),
            "tangential_traction_pa": whole.at_faces(stress.tangential_pa),
            "face_stress_pa": components(whole.at_faces(tensors.cells_pa[parents])),
            "face_stress_error_pa": whole.at_faces(tensors.errors_pa[parents]),
        },
        surface=seen_surface(path, point),
    )


def surface_state(path: LoadingPath, point: PathPoint) -> SurfaceState:
    """Hand over the contact surface: the faces that look up at rest.

    With a wide barrier the indenter comes with all that lies within d_hat of it: that is what the
    gel takes its shape from, and what depths count from.
    """
    options, top = path.model.contact_options, top_surface(path.model)
    reach = options.distance_m if options.is_wide else 0.0
    return SurfaceState(
        positions_rest=top.rest,
        positions=top.of(point.state.positions),
        faces=top.faces,
        indenter=grown(path.indenter, reach) if reach else path.indenter,
        indenter_position=point.state.tip - reach * point.state.rotation[:, 2],
        indenter_rotation=point.state.rotation.copy(),
        standoff_m=options.distance_m - reach,
        mesh_axis_m=top.mesh_axis_m,
    )


def seen_surface(path: LoadingPath, point: PathPoint) -> SurfaceState:
    """Return the contact surface around the body itself, where a wide barrier made that larger.

    The gel is taken for parallel to what was found, and touches the body at the same depth.
    """
    surface, options = surface_state(path, point), path.model.contact_options
    if not options.is_wide:
        return surface
    facets = linear_facets(surface.faces)
    normals = np.zeros_like(surface.positions)
    np.add.at(normals, facets, doubled_areas(surface.positions, facets)[:, None])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    moved = options.distance_m * (normals - surface.indenter_rotation[:, 2])
    return replace(surface, indenter=path.indenter, positions=surface.positions + moved)


def top_surface(model: Model) -> TopSurface:
    """Return the whole contact surface at rest; a part of a pad is mirrored."""
    normals = doubled_areas(model.nodes, model.faces)
    looks_up = normals[:, 2] > 0.5 * np.linalg.norm(normals, axis=1)
    nodes, faces = renumbered(model.faces[looks_up])
    whole = WholeSurface(model.mesh.symmetry, model.nodes[nodes])
    return TopSurface(
        rest=whole.at_nodes(model.nodes[nodes]),
        faces=whole.faces(faces),
        sources=nodes[whole.sources],
        signs=whole.signs,
        mesh_axis_m=model.mesh.axis_m,
    )


KEPT = 12
"""States of a path, at most."""
_BY_DEPTH = 1.5  # under a ball depth goes with force^(2/3): such forces are about evenly deep
_LESS = 0.97  # by so much a state has to be less loaded than the one it leads to


def intermediate_state(
    path: LoadingPath, point: PathPoint, *, stiffer: float = 1.0
) -> IntermediateState:
    """Return an equilibrium as the camera and the contact need it.

    A gel ``stiffer`` times as stiff as the path's has the same state at as many times the force.
    """
    pressure = surface_traction(path.model, point).pressure_pa
    return IntermediateState(
        force_n=stiffer * float(point.force_n[2]),
        depth_m=point.depth_m,
        surface=seen_surface(path, point),
        pressure_pa=stiffer * pressure[top_surface(path.model).sources],
    )


class IntermediateStates:
    """Chooses a few of the states that a path kept up to a force [N]; no press is made for it.

    They balance to 0.01 % of the contact's force; ``stiffer`` is as for ``intermediate_state``.
    """

    def __init__(self, path: LoadingPath, force_n: float, *, stiffer: float = 1.0) -> None:
        self._path, self._stiffer = path, stiffer
        self._wanted_n = [(k / KEPT) ** _BY_DEPTH * force_n for k in range(1, KEPT)]
        self._state = cache(lambda k: intermediate_state(path, path.points[k], stiffer=stiffer))

    def before(self, force_n: float) -> list[IntermediateState]:
        """Return those that carried clearly less than a force [N], the smallest force first."""
        forces = [self._stiffer * float(point.force_n[2]) for point in self._path.points]
        below = [k for k, each in enumerate(forces) if 0.0 < each < _LESS * force_n]
        wanted = [each for each in self._wanted_n if each < force_n]
        nearest = {min(below, key=lambda k: abs(forces[k] - each)) for each in wanted if below}
        return [self._state(k) for k in sorted(nearest, key=lambda k: forces[k])]


# VTK's names of cells by their nodes: faces and tetrahedra, linear and quadratic.
_CELLS = {3: "TRIANGLE", 6: "QUADRATIC_TRIANGLE", 4: "TETRA", 10: "QUADRATIC_TETRA"}
# An analytic indenter's underside is drawn with so many rings and sectors.
_RINGS, _SECTORS = 60, 96
_INSIDE = 1.0 - 1e-9  # just inside a rim, beside which there is no underside
_PLATE_SHARE = 0.8  # of the gel's largest coordinate: so wide a plate is drawn


def vtu(
    cells: IntArray,
    points: FloatArray,
    on_points: Mapping[str, FloatArray],
    on_cells: Mapping[str, FloatArray],
) -> bytes:
    """Return a .vtu file of faces or tetrahedra, [cell_count, node_count], of points [n, 3] [m]."""
    # Here, since importing it takes a second, and a press alone writes no file.
    pyvista = importlib.import_module("pyvista")
    kind = getattr(pyvista.CellType, _CELLS[cells.shape[1]])
    grid = pyvista.UnstructuredGrid({kind: cells}, points)
    grid.point_data.update(on_points)
    grid.cell_data.update(on_cells)
    writer = importlib.import_module("vtkmodules.vtkIOXML").vtkXMLUnstructuredGridWriter()
    writer.SetInputData(grid)
    writer.SetDataModeToBinary()
    writer.WriteToOutputStringOn()
    writer.Write()
    return str(writer.GetOutputString()).encode("ascii")


def gel_vtu(model: Model, point: PathPoint) -> bytes:
    """Return the whole deformed gel with its Cauchy stress at nodes and in cells, and its error."""
    stress = cauchy_stress(model, point.state.positions)
    whole = WholeSurface(model.mesh.symmetry, model.nodes)
    on_points = {
        "displacement_m": whole.at_nodes(point.state.positions - model.nodes),
        "cauchy_stress_pa": components(whole.at_nodes(stress.nodes_pa)),
    }
    on_cells = {
        "cauchy_stress_pa": components(whole.at_faces(stress.cells_pa)),
        "cauchy_stress_error_pa": whole.at_faces(stress.errors_pa),
    }
    positions = whole.at_nodes(point.state.positions)
    return vtu(whole.faces(model.elements), positions, on_points, on_cells)


def indenter_vtu(surface: SurfaceState) -> bytes:
    """Return the indenter's surface where it stands: of an analytic body the side that presses."""
    points, faces = indenter_surface(surface.indenter, float(np.abs(surface.positions).max()))
    placed = points @ surface.indenter_rotation.T + surface.indenter_position
    return vtu(faces, placed, {}, {})


def indenter_surface(indenter: Indenter, gel_m: float) -> tuple[FloatArray, IntArray]:
    """Return vertices [m] and triangles of an indenter in its own frame, as ``indenter_vtu``.

    A plate, which has no end, is drawn by the gel's largest coordinate [m].
    """
    if isinstance(indenter, MeshIndenter):
        return indenter.surface.vertices, np.asarray(indenter.surface.faces, dtype=np.int32)
    widest = getattr(indenter, "radius_m", _PLATE_SHARE * gel_m)
    radii = widest * np.sin(0.5 * np.pi * np.arange(_RINGS + 1) / _RINGS)
    heights = indenter.lower_surface(radii * _INSIDE, np.zeros_like(radii))
    return turned_triangles(radii, heights, _SECTORS)


STATES = 24
"""Of a press at most, the one without contact among them."""


def passed_states(path: LoadingPath) -> dict[str, AnyArray]:
    """Return the gel and the indenter in states of a path that kept all; units in the names.

    The first is without contact. They balance as the path's steps do, to 0.1 % of the force. Fields
    of k states have the shape [k, ...]; those of the indenter's surface are in its own frame.
    ``elements`` lists the nodes of tetrahedra, ``faces`` the corners of the surface's.
    """
    model, points = path.model, path.points
    chosen = np.unique(np.linspace(0, len(points) - 1, STATES - 1).round().astype(int)).tolist()
    kept = [points[k] for k in chosen]
    whole = WholeSurface(model.mesh.symmetry, model.nodes)
    tractions = [surface_traction(model, each) for each in kept]
    start = path.untouched(0.0)
    nodes = [whole.at_nodes(each) for each in (start.positions, *(p.state.positions for p in kept))]
    still = np.zeros(len(nodes[0]))
    pressure = [still, *(whole.at_nodes(each.pressure_pa) for each in tractions)]
    shear = [np.zeros_like(nodes[0]), *(whole.at_nodes(each.tangential_pa) for each in tractions)]
    vertices, triangles = indenter_surface(path.indenter, float(np.abs(nodes[0]).max()))
    young, poisson = (whole.at_faces(each) for each in model.materials)
    states = [start, *(each.state for each in kept)]
    return {
        "elements": whole.faces(model.elements),
        "faces": whole.faces(model.faces)[:, :3],
        "node_rest_m": whole.at_nodes(model.nodes),
        "node_m": np.array(nodes),
        "contact_pressure_pa": np.array(pressure, dtype=np.float32),
        "contact_shear_pa": np.array(shear, dtype=np.float32),
        "depth_m": np.array([0.0, *(each.depth_m for each in kept)]),
        "force_n": np.array([np.zeros(3), *(each.force_n for each in kept)]),
        "indenter_tip_m": np.array([each.tip for each in states]),
        "indenter_rotation": np.array([each.rotation for each in states]),
        "indenter_vertex_m": vertices,
        "indenter_faces": triangles,
        "young_pa": young,
        "poisson": poisson,
    }
