"""USD: the gel as a TetMesh in time, the indenter, the camera. Metres, kilograms, z up.

The gel's physics follow the proposed schema of deformables, as newton's importer reads it. Its
API names are not registered in USD itself yet, so they are written into the prims' metadata.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from sim.sensor.sensor import Sensor, load_sensor
from tacauchy_rig.app.exporting.episode import needed
from tacauchy_rig.app.exporting.states import states_of
from tacauchy_rig.core.arrays import AnyArray

STATES_A_SECOND = 12
PRIMVARS = {"contact_pressure_pa": "Float", "contact_shear_pa": "Vector3f"}
_FOCAL_MM, _TENTHS = 10.0, 10.0
"""A camera's focal length, and USD's apertures, which are in tenths of a scene unit."""
_PARALLEL_M = 0.02
"""How far below the gel's top a camera of parallel rays is put."""


def write_usd(press: Path, out: Path) -> None:
    """Write ``press.usd`` of a press.

    Raises:
        RecordError: The folder holds no states of a press.
    """
    found = states_of(press)
    Usd, UsdGeom = needed("pxr.Usd"), needed("pxr.UsdGeom")
    stage = Usd.Stage.CreateNew(str(out / "press.usd"))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    needed("pxr.UsdPhysics").SetStageKilogramsPerUnit(stage, 1.0)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(len(found["node_m"]) - 1)
    stage.SetTimeCodesPerSecond(STATES_A_SECOND)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/Press").GetPrim())
    _define_gel(stage, found)
    _define_indenter(stage, found)
    if sensor := str(found["sensor"]):
        _define_camera(stage, load_sensor(sensor))
    stage.GetRootLayer().Save()


def _define_gel(stage: Any, found: dict[str, AnyArray]) -> None:
    """Define the gel's mesh, its samples in time and its material."""
    UsdGeom, UsdShade, Sdf = (needed(f"pxr.{name}") for name in ("UsdGeom", "UsdShade", "Sdf"))
    body = UsdGeom.Xform.Define(stage, "/Press/Gel").GetPrim()
    body.AddAppliedSchema("PhysicsDeformableBodyAPI")
    mesh = UsdGeom.TetMesh.Define(stage, "/Press/Gel/Mesh")
    prim, corners = mesh.GetPrim(), np.unique(found["elements"][:, :4])
    number = np.zeros(len(found["node_rest_m"]), dtype=np.int32)
    number[corners] = np.arange(len(corners))
    mesh.CreateTetVertexIndicesAttr(_array("Vec4i", number[found["elements"][:, :4]]))
    mesh.CreateSurfaceFaceVertexIndicesAttr(_array("Vec3i", number[found["faces"]]))
    mesh.CreateOrientationAttr(UsdGeom.Tokens.rightHanded)
    for name in ("PhysicsVolumeDeformableSimAPI", "PhysicsCollisionAPI"):
        prim.AddAppliedSchema(name)
    points = mesh.CreatePointsAttr(_array("Vec3f", found["node_rest_m"][corners]))
    rest = Sdf.ValueTypeNames.Point3fArray
    prim.CreateAttribute("physics:restShapePoints", rest).Set(points.Get())
    moved = {"displacement_m": "Vector3f", **PRIMVARS}
    api, kinds = UsdGeom.PrimvarsAPI(prim), Sdf.ValueTypeNames
    fields = {
        name: api.CreatePrimvar(name, getattr(kinds, f"{kind}Array"), UsdGeom.Tokens.vertex)
        for name, kind in moved.items()
    }
    extent = mesh.CreateExtentAttr()
    for k, nodes in enumerate(found["node_m"]):
        placed = nodes[corners]
        points.Set(_array("Vec3f", placed), k)
        extent.Set(_array("Vec3f", np.array([placed.min(axis=0), placed.max(axis=0)])), k)
        values = {"displacement_m": placed - found["node_rest_m"][corners]}
        values |= {name: found[name][k][corners] for name in PRIMVARS}
        for name, array in values.items():
            fields[name].Set(_array("Vec3f" if array.ndim > 1 else "Float", array), k)
    material = UsdShade.Material.Define(stage, "/Press/Material")
    of_material = material.GetPrim()
    of_material.AddAppliedSchema("PhysicsVolumeDeformableMaterialAPI")
    touched = int(np.argmax(found["node_rest_m"][found["elements"][:, :4], 2].sum(axis=1)))
    for name, value in (
        ("youngsModulus", found["young_pa"][touched]),
        ("poissonsRatio", found["poisson"][touched]),
        ("density", found["density_kg_m3"]),
    ):
        of_material.CreateAttribute(f"physics:{name}", kinds.Float).Set(float(value))
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(material, materialPurpose="physics")
    UsdShade.MaterialBindingAPI.Apply(body).Bind(material, materialPurpose="physics")


def _define_indenter(stage: Any, found: dict[str, AnyArray]) -> None:
    """Define the rigid indenter, which moves as a whole."""
    UsdGeom, Gf = needed("pxr.UsdGeom"), needed("pxr.Gf")
    mesh = UsdGeom.Mesh.Define(stage, "/Press/Indenter")
    vertices, faces = found["indenter_vertex_m"], found["indenter_faces"]
    mesh.CreatePointsAttr(_array("Vec3f", vertices))
    mesh.CreateFaceVertexIndicesAttr(_array("Int", faces.reshape(-1)))
    mesh.CreateFaceVertexCountsAttr(_array("Int", np.full(len(faces), faces.shape[1])))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateExtentAttr(_array("Vec3f", np.array([vertices.min(axis=0), vertices.max(axis=0)])))
    moves = mesh.AddTransformOp()
    for k, (tip, turned) in enumerate(
        zip(found["indenter_tip_m"], found["indenter_rotation"], strict=True)
    ):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[3, :3] = turned.T, tip  # USD multiplies rows from the left
        moves.Set(Gf.Matrix4d(*matrix.reshape(-1).tolist()), k)


def _define_camera(stage: Any, sensor: Sensor) -> None:
    """Define the sensor's camera, which looks up through the gel; of a mirrored one as unmirrored.

    Its scale holds at the middle of the unloaded surface.
    """
    view = sensor.camera
    UsdGeom, Gf = needed("pxr.UsdGeom"), needed("pxr.Gf")
    camera = UsdGeom.Camera.Define(stage, "/Press/Camera")
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
    return getattr(needed("pxr.Vt"), f"{kind}Array").FromNumpy(np.ascontiguousarray(values, number))
