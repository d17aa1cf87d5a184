"""USD: the gel as a TetMesh in time, the indenter, the camera. Metres, kilograms, z up.

The gel's physics follow the proposed schema of deformables, as newton's importer reads it. Its
API names are not registered in USD itself yet, so they are written into the prims' metadata.
"""

from pathlib import Path
from typing import Any

import numpy as np

from sim.mesh.brick_refinement import sensor_mesh
from sim.mesh.elements import boundary_faces
from sim.scene.pad import BoxPad
from sim.sensor.sensor import Sensor, load_sensor
from tacauchy_rig.app.exporting.episode_and_import_toml import needed
from tacauchy_rig.app.exporting.paraview import states_of
from tacauchy_rig.core.arrays import AnyArray
from tacauchy_rig.core.errors import ConfigError

_PARTS = ("Gf", "Sdf", "Usd", "UsdGeom", "UsdPhysics", "UsdShade", "Vt")
Gf, Sdf, Usd, UsdGeom, UsdPhysics, UsdShade, Vt = (needed(f"pxr.{name}") for name in _PARTS)
Kinds = Sdf.ValueTypeNames

STATES_A_SECOND = 12
PRIMVARS = {"contact_pressure_pa": "Float", "contact_shear_pa": "Vector3f"}
_GEL_COLOUR = (0.55, 0.6, 0.65)
_FOCAL_MM, _TENTHS = 10.0, 10.0
"""A camera's focal length, and USD's apertures, which are in tenths of a scene unit."""
_EDGE_M, _WALL_M, _DEEP_M = 1.25e-3, 1e-3, 0.025
"""Edges of a sensor's mesh at its surface, and a case's walls and depth: sensor files have none."""
_PARALLEL_M = 0.02
"""How far below the gel's top a camera of parallel rays is put."""


def write_usd(press: Path, out: Path) -> None:
    """Write ``press.usd`` of a press, or of a sensor, by name or file, ``NAME.usd``.

    Raises:
        RecordError: The folder holds no states of a press.
    """
    if not press.is_dir():
        _write_sensor(load_sensor(str(press)), out)
        return
    found = states_of(press)
    stage = _new_stage(out / "press.usd", "Press")
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(len(found["node_m"]) - 1)
    stage.SetTimeCodesPerSecond(STATES_A_SECOND)
    _define_gel(stage, found)
    _define_indenter(stage, found)
    if sensor := str(found["sensor"]):
        _define_camera(stage, load_sensor(sensor))
    stage.GetRootLayer().Save()


def _write_sensor(sensor: Sensor, out: Path) -> None:
    """Write a sensor at rest: gel, of the touched layer's material, case, and camera.

    Raises:
        ConfigError: A mesh bounds the pad.
    """
    pad = sensor.pad
    if not isinstance(pad, BoxPad):
        raise ConfigError(f"sensor {sensor.name}: its pad is a mesh", remedy="export a press of it")
    mesh = sensor_mesh(pad, edge_m=_EDGE_M)
    faces, count = boundary_faces(mesh.tets)[0], len(mesh.vertices)
    found: dict[str, AnyArray] = {
        "node_rest_m": mesh.vertices,
        "node_m": mesh.vertices[None],
        "elements": mesh.tets,
        "faces": faces,
        "young_pa": np.full(len(mesh.tets), sensor.material.young_pa),
        "poisson": np.full(len(mesh.tets), sensor.material.poisson),
        "density_kg_m3": np.array(sensor.material.density_kg_m3),
        "contact_pressure_pa": np.zeros((1, count)),
        "contact_shear_pa": np.zeros((1, count, 3)),
    }
    stage = _new_stage(out / f"{sensor.name}.usd", "Sensor")
    _define_gel(stage, found)
    half = np.array(pad.half_extents())
    square = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    rings = [(half, 0.0), (half + _WALL_M, 0.0), (half + _WALL_M, -_DEEP_M), (half, -_DEEP_M)]
    corners = np.concatenate([np.column_stack([square * s, np.full(4, z)]) for s, z in rings])
    sides = [
        (4 * r + k, 4 * ((r + 1) % 4) + k, 4 * ((r + 1) % 4) + (k + 1) % 4, 4 * r + (k + 1) % 4)
        for r in range(4)
        for k in range(4)
    ]
    prim = _define_mesh(stage, "Case", corners, np.array(sides), (0.08, 0.08, 0.08))
    UsdPhysics.CollisionAPI.Apply(prim)
    _define_camera(stage, sensor)
    stage.GetRootLayer().Save()


def _colour(stage: Any, prim: Any, colour: tuple[float, float, float]) -> None:
    """Give the stage's material a surface, and a prim that material."""
    material = UsdShade.Material.Get(stage, f"{stage.GetDefaultPrim().GetPath()}/Material")
    shader = UsdShade.Shader.Define(stage, f"{material.GetPath()}/Surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("diffuseColor", Kinds.Color3f).Set(Gf.Vec3f(*colour))
    surface = shader.CreateOutput("surface", Kinds.Token)
    material.CreateSurfaceOutput().ConnectToSource(surface)
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(material)


def _new_stage(path: Path, root: str) -> Any:
    """Return a stage in metres and kilograms, z up, with a default prim."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdPhysics.SetStageKilogramsPerUnit(stage, 1.0)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, f"/{root}").GetPrim())
    return stage


def _define_gel(stage: Any, found: dict[str, AnyArray]) -> None:
    """Define the gel's mesh, the skin that renderers draw, their samples in time, the material."""
    root = stage.GetDefaultPrim().GetPath()
    body = UsdGeom.Xform.Define(stage, f"{root}/Gel").GetPrim()
    body.AddAppliedSchema("PhysicsDeformableBodyAPI")
    mesh = UsdGeom.TetMesh.Define(stage, f"{root}/Gel/Mesh")
    prim, corners = mesh.GetPrim(), np.unique(found["elements"][:, :4])
    number = np.zeros(len(found["node_rest_m"]), dtype=np.int32)
    number[corners] = np.arange(len(corners))
    mesh.CreateTetVertexIndicesAttr(_array("Vec4i", number[found["elements"][:, :4]]))
    mesh.CreateSurfaceFaceVertexIndicesAttr(_array("Vec3i", number[found["faces"]]))
    mesh.CreateOrientationAttr(UsdGeom.Tokens.rightHanded)
    for name in ("PhysicsVolumeDeformableSimAPI", "PhysicsCollisionAPI"):
        prim.AddAppliedSchema(name)
    mesh.CreatePointsAttr(_array("Vec3f", found["node_rest_m"][corners]))
    rest = prim.CreateAttribute("physics:restShapePoints", Kinds.Point3fArray)
    rest.Set(mesh.GetPointsAttr().Get())
    outer, faces = np.unique(found["faces"], return_inverse=True)
    shown = _define_mesh(
        stage, "Gel/Skin", found["node_rest_m"][outer], faces.reshape(-1, 3), _GEL_COLOUR
    )
    _add_samples(prim, corners, found)
    _add_samples(shown, outer, found)
    material = UsdShade.Material.Define(stage, f"{root}/Material")
    of_material = material.GetPrim()
    of_material.AddAppliedSchema("PhysicsVolumeDeformableMaterialAPI")
    touched = int(np.argmax(found["node_rest_m"][found["elements"][:, :4], 2].sum(axis=1)))
    for name, value in (
        ("youngsModulus", found["young_pa"][touched]),
        ("poissonsRatio", found["poisson"][touched]),
        ("density", found["density_kg_m3"]),
    ):
        of_material.CreateAttribute(f"physics:{name}", Kinds.Float).Set(float(value))
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(material, materialPurpose="physics")
    UsdShade.MaterialBindingAPI.Apply(body).Bind(material, materialPurpose="physics")
    _colour(stage, shown, _GEL_COLOUR)


def _add_samples(prim: Any, nodes: AnyArray, found: dict[str, AnyArray]) -> None:
    """Add where nodes are in time, and the fields there."""
    points, api = UsdGeom.PointBased(prim), UsdGeom.PrimvarsAPI(prim)
    fields = {
        name: api.CreatePrimvar(name, getattr(Kinds, f"{kind}Array"), UsdGeom.Tokens.vertex)
        for name, kind in {"displacement_m": "Vector3f", **PRIMVARS}.items()
    }
    at, extent = points.CreatePointsAttr(), points.CreateExtentAttr()
    for k, positions in enumerate(found["node_m"]):
        placed = positions[nodes]
        at.Set(_array("Vec3f", placed), k)
        extent.Set(_array("Vec3f", np.array([placed.min(axis=0), placed.max(axis=0)])), k)
        values = {"displacement_m": placed - found["node_rest_m"][nodes]}
        values |= {name: found[name][k][nodes] for name in PRIMVARS}
        for name, array in values.items():
            fields[name].Set(_array("Vec3f" if array.ndim > 1 else "Float", array), k)


def _define_indenter(stage: Any, found: dict[str, AnyArray]) -> None:
    """Define the rigid indenter, which moves as a whole."""
    vertices, faces = found["indenter_vertex_m"], found["indenter_faces"]
    mesh = UsdGeom.Mesh(_define_mesh(stage, "Indenter", vertices, faces, (0.6, 0.6, 0.6)))
    moves = mesh.AddTransformOp()
    for k, (tip, turned) in enumerate(
        zip(found["indenter_tip_m"], found["indenter_rotation"], strict=True)
    ):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[3, :3] = turned.T, tip  # USD multiplies rows from the left
        moves.Set(Gf.Matrix4d(*matrix.reshape(-1).tolist()), k)


def _define_mesh(
    stage: Any, name: str, points: AnyArray, faces: AnyArray, colour: tuple[float, float, float]
) -> Any:
    """Define a mesh of flat faces with corners [m] below the default prim, and return its prim."""
    mesh = UsdGeom.Mesh.Define(stage, f"{stage.GetDefaultPrim().GetPath()}/{name}")
    mesh.CreatePointsAttr(_array("Vec3f", points))
    mesh.CreateFaceVertexIndicesAttr(_array("Int", faces.reshape(-1)))
    mesh.CreateFaceVertexCountsAttr(_array("Int", np.full(len(faces), faces.shape[1])))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateExtentAttr(_array("Vec3f", np.array([points.min(axis=0), points.max(axis=0)])))
    mesh.CreateDisplayColorAttr(_array("Vec3f", np.array([colour])))
    return mesh.GetPrim()


def _define_camera(stage: Any, sensor: Sensor) -> None:
    """Define the sensor's camera, which looks up through the gel; of a mirrored one as unmirrored.

    Its scale holds at the middle of the unloaded surface.
    """
    view = sensor.camera
    camera = UsdGeom.Camera.Define(stage, f"{stage.GetDefaultPrim().GetPath()}/Camera")
    size = np.array([view.width * view.scale_x_m, view.height * view.scale_y_m])
    is_parallel = np.isinf(view.distance_m)
    distance_m = _PARALLEL_M if is_parallel else view.distance_m
    kind = UsdGeom.Tokens.orthographic if is_parallel else UsdGeom.Tokens.perspective
    camera.CreateProjectionAttr(kind)
    aperture = _TENTHS * size if is_parallel else _FOCAL_MM * size / distance_m
    camera.CreateFocalLengthAttr(_FOCAL_MM)
    camera.CreateHorizontalApertureAttr(float(aperture[0]))
    camera.CreateVerticalApertureAttr(float(aperture[1]))
    camera.CreateClippingRangeAttr(Gf.Vec2f(1e-4, 1.0))
    middle = view.to_pad(np.array([0.5 * (view.width - 1), 0.5 * (view.height - 1)]))
    cosine, sine = np.cos(view.rotation_rad), np.sin(view.rotation_rad)
    matrix = np.eye(4)  # its own axes: x along columns, y against rows, and it looks along -z
    matrix[:3, :3] = (cosine, sine, 0.0), (sine, -cosine, 0.0), (0.0, 0.0, -1.0)
    matrix[3, :3] = (*middle, sensor.pad.height_m - distance_m)
    camera.AddTransformOp().Set(Gf.Matrix4d(*matrix.reshape(-1).tolist()))


def _array(kind: str, values: AnyArray) -> Any:
    """Return numbers as one of USD's arrays."""
    number = np.int32 if kind.endswith(("i", "Int")) else np.float32
    return getattr(Vt, f"{kind}Array").FromNumpy(np.ascontiguousarray(values, number))
