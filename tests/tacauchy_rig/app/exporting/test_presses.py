"""A press in time for ParaView and USD, and a calibration in Taxim's form."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyvista
from pxr import Gf, Usd, UsdGeom, UsdShade, UsdValidation

from sim.effects.presets import build_model
from sim.fields.saved_press import passed_states
from sim.press_arguments import scene_from
from sim.sensor.sensor import load_sensor
from sim.solve.loading_path import LoadingPath
from tacauchy_rig.app.exporting.formats import Format, export
from tacauchy_rig.app.exporting.taxim import ISAAC_BINS, TAXIM_BINS
from tacauchy_rig.app.replay.press_folder import STATES_NAME
from tacauchy_rig.core.errors import ConfigError, RecordError
from tacauchy_rig.core.image_codec import decode_rgb
from tacauchy_rig.core.store.run_store import pack_arrays


@pytest.fixture(scope="module")
def press(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the states of a ball in a quarter of a disc."""
    scene = scene_from(
        "--pad disc:radius=8mm,height=4mm --young 0.3MPa --poisson 0.47 "
        "--indenter sphere:diameter=8mm --depth 0.2mm --preset fast"
    )
    path = LoadingPath(build_model(scene), scene.indenter, keeps_all=True)
    path.advance(0.2e-3)
    about = {"sensor": np.array("gelsight-mini"), "density_kg_m3": np.array(1000.0)}
    folder = tmp_path_factory.mktemp("press")
    (folder / STATES_NAME).write_bytes(pack_arrays({**passed_states(path), **about}))
    return folder


@pytest.fixture(scope="module")
def states(press: Path) -> dict[str, Any]:
    """Its arrays."""
    with np.load(press / STATES_NAME) as found:
        return dict(found)


def test_states_go_from_rest_to_the_end(states: dict[str, Any]) -> None:
    """The whole gel; its force is about that of the corners' pressure on its coarse surface."""
    assert states["depth_m"][0] == 0.0
    assert states["depth_m"][-1] == pytest.approx(0.2e-3)
    assert (np.diff(states["depth_m"]) >= 0.0).all()
    assert np.array_equal(states["node_m"][0], states["node_rest_m"])
    corners = states["node_m"][-1][states["faces"]]
    areas = np.linalg.norm(np.cross(*(corners[:, 1:] - corners[:, :1]).swapaxes(0, 1)), axis=1) / 2
    pressure = states["contact_pressure_pa"][-1][states["faces"]].mean(axis=1)
    assert areas @ pressure == pytest.approx(states["force_n"][-1, 2], rel=0.15)


def test_paraview_reads_the_series(press: Path, states: dict[str, Any], tmp_path: Path) -> None:
    """Gel and indenter of each state; the gel's tetrahedra keep their nodes."""
    export(press, tmp_path / "out", Format.VTU)
    reader = pyvista.get_reader(tmp_path / "out" / "series.pvd")
    assert len(reader.time_values) == len(states["node_m"])
    reader.set_active_time_point(len(reader.time_values) - 1)
    gel, indenter = reader.read()
    np.testing.assert_allclose(gel.points, states["node_m"][-1], atol=1e-9)
    np.testing.assert_array_equal(gel["contact_pressure_pa"], states["contact_pressure_pa"][-1])
    assert indenter.bounds[4] == pytest.approx(states["indenter_tip_m"][-1, 2], abs=1e-9)


def test_usd_is_valid_and_in_time(press: Path, states: dict[str, Any], tmp_path: Path) -> None:
    """All of USD's validators have nothing to say; points, fields and matter are the press's."""
    export(press, tmp_path / "out", Format.USD)
    stage = Usd.Stage.Open(str(tmp_path / "out" / "press.usd"))
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert len(validators) > 20
    found = UsdValidation.ValidationContext(validators).Validate(stage)
    assert [each.GetMessage() for each in found] == []
    mesh = UsdGeom.TetMesh(stage.GetPrimAtPath("/Press/Gel/Mesh"))
    last = len(states["node_m"]) - 1
    assert mesh.GetPointsAttr().GetTimeSamples() == list(range(last + 1))
    corners = np.unique(states["elements"][:, :4])
    placed = np.array(mesh.GetPointsAttr().Get(last))
    np.testing.assert_allclose(placed, states["node_m"][last][corners], atol=1e-9)
    tets = placed[np.array(mesh.GetTetVertexIndicesAttr().Get())].astype(float)
    assert np.linalg.det(tets[:, 1:] - tets[:, :1]).min() > 0.0
    pressure = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("contact_pressure_pa").Get(last)
    np.testing.assert_array_equal(pressure, states["contact_pressure_pa"][last][corners])
    outer = np.unique(states["faces"])
    skin = np.array(UsdGeom.Mesh(stage.GetPrimAtPath("/Press/Gel/Skin")).GetPointsAttr().Get(last))
    np.testing.assert_allclose(skin, states["node_m"][last][outer], atol=1e-9)
    binding = UsdShade.MaterialBindingAPI(mesh.GetPrim())
    material = binding.ComputeBoundMaterial("physics")[0].GetPrim()
    assert material.GetAttribute("physics:youngsModulus").Get() == pytest.approx(0.3e6)
    lowest = UsdGeom.Imageable(stage.GetPrimAtPath("/Press/Indenter")).ComputeWorldBound(
        last, UsdGeom.Tokens.default_
    )
    low = lowest.ComputeAlignedRange().GetMin()[2]
    assert low == pytest.approx(states["indenter_tip_m"][last, 2], abs=1e-7)


@pytest.mark.parametrize("sensor", ["gelsight-mini", "digit", "9dtact"])
def test_usd_of_a_sensor_is_valid(sensor: str, tmp_path: Path) -> None:
    """Gel, case, camera and material, of which USD's validators have nothing to say."""
    export(Path(sensor), tmp_path / "out", Format.USD)
    stage = Usd.Stage.Open(str(tmp_path / "out" / f"{sensor}.usd"))
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert not UsdValidation.ValidationContext(validators).Validate(stage)
    for prim in ("Gel/Mesh", "Gel/Skin", "Case", "Camera", "Material"):
        assert stage.GetPrimAtPath(f"/Sensor/{prim}").IsDefined()


def test_the_camera_sees_what_the_sensor_s_does(press: Path, tmp_path: Path) -> None:
    """A place on the gel is in the same pixel by USD's own camera."""
    export(press, tmp_path / "out", Format.USD)
    stage = Usd.Stage.Open(str(tmp_path / "out" / "press.usd"))
    seen = UsdGeom.Camera(stage.GetPrimAtPath("/Press/Camera")).GetCamera(0).frustum
    sensor = load_sensor("gelsight-mini")
    place = np.array([2e-3, -3e-3, sensor.pad.height_m])
    in_view = (seen.ComputeViewMatrix() * seen.ComputeProjectionMatrix()).Transform(
        Gf.Vec3d(*place.tolist())
    )
    size = np.array([sensor.camera.width, sensor.camera.height])
    column, row = (np.array([in_view[0], -in_view[1]]) + 1.0) / 2.0 * size - 0.5
    assert (column, row) == pytest.approx(tuple(sensor.camera.to_pixels(place[:2])), abs=0.01)


@pytest.mark.slow
@pytest.mark.timeout(600)  # newton's kernels are compiled
def test_newton_imports_the_gel(press: Path, states: dict[str, Any], tmp_path: Path) -> None:
    """A soft body with the gel's tetrahedra and Lame's constants."""
    newton = pytest.importorskip("newton")
    pytest.importorskip("newton_usd_schemas")
    export(press, tmp_path / "out", Format.USD)
    builder = newton.ModelBuilder()
    file = str(tmp_path / "out" / "press.usd")
    found = builder.add_usd(file, return_deformable_results=True)["path_soft_map"]
    assert found["/Press/Gel/Mesh"]["tet"] == (0, len(states["elements"]))
    mu, lam, _ = builder.finalize(device="cpu").tet_materials.numpy()[0]
    assert mu == pytest.approx(0.3e6 / (2.0 * 1.47), rel=1e-4)
    assert lam / (2.0 * (lam + mu)) == pytest.approx(0.47, abs=1e-4)


def test_a_folder_without_states_says_what_makes_them(tmp_path: Path) -> None:
    """A run's replay has surfaces only."""
    with pytest.raises(RecordError, match=r"holds no states\.npz") as caught:
        export(tmp_path, tmp_path / "out", Format.USD)
    assert "--out" in caught.value.remedy


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[Format, Path]:
    """The nominal optics of a GelSight Mini in both forms."""
    out = tmp_path_factory.mktemp("calibration")
    for form in (Format.ISAACLAB, Format.TAXIM):
        export(Path("gelsight-mini"), out / form, form)
    return {form: out / form for form in (Format.ISAACLAB, Format.TAXIM)}


def colour(table: np.ndarray, slope: float, turn: float, x: float, y: float) -> float:
    """Return a change of colour by the renderers' own rule: the bin that a slope is in."""
    bins = len(table) - 1
    row = int(np.arctan(slope) / (0.5 * np.pi / bins))
    column = int((turn + np.pi) / (2.0 * np.pi / bins))
    return float(table[row, column] @ [x * x, y * y, x * y, x, y, 1.0])


def test_slopes_have_the_lamps_colours(folders: dict[Format, Path]) -> None:
    """A slope is lit by the lamps that it faces; Taxim's opposite sign and order are kept."""
    with np.load(folders[Format.ISAACLAB] / "polycalib.npz") as tables:
        isaac = {name: tables[f"grad_{name}"] for name in "rgb"}
    with np.load(folders[Format.TAXIM] / "polycalib.npz") as tables:
        taxim = {name: tables[f"grad_{name}"] for name in "rgb"}
    assert isaac["r"].shape == (ISAAC_BINS, ISAAC_BINS, 6)
    assert taxim["r"].shape == (TAXIM_BINS, TAXIM_BINS, 6)
    # Lamps stand at azimuths -90, 30 and 150 degrees, elevation 25. The camera sees the surface
    # from below: one that rises along the rows turns from the first to the others (Lambert).
    for slope in (0.1, 0.3):
        angle, elevation = np.arctan(slope), np.radians(25.0)
        lamps = {"r": (90, 10, 10), "g": (15, 80, 20), "b": (10, 15, 90)}
        for name, levels in lamps.items():
            gains = [
                level
                * (
                    np.cos(elevation) * np.sin(angle) * facing
                    + np.sin(elevation) * (np.cos(angle) - 1.0)
                )
                for level, facing in zip(levels, (-1.0, 0.5, 0.5), strict=True)
            ]
            found = colour(isaac[name], slope, 0.5 * np.pi, 160.0, 120.0)
            assert found == pytest.approx(sum(gains), abs=1.5)
            other = {"r": "b", "g": "g", "b": "r"}[name]
            opposite = colour(taxim[other], slope, -0.5 * np.pi, 160.0, 120.0)
            assert opposite == pytest.approx(found, abs=1.5), "one bin is 1.4 degrees"


def test_level_gel_is_the_frame(folders: dict[Format, Path]) -> None:
    """Slope zero adds nothing, in whatever direction; the frame is the one that was given."""
    for folder in folders.values():
        with np.load(folder / "polycalib.npz") as tables:
            assert not any(tables[f"grad_{name}"][0].any() for name in "rgb")
    frame = decode_rgb((folders[Format.ISAACLAB] / "bg.jpg").read_bytes())
    assert frame is not None
    assert frame.shape == (240, 320, 3)
    with np.load(folders[Format.TAXIM] / "dataPack.npz") as data:
        assert np.array_equal(data["f0"], frame)


def test_colours_by_depth_are_refused(tmp_path: Path) -> None:
    """A sensor whose gel is seen by its thickness has no slopes to tabulate."""
    with pytest.raises(ConfigError, match="one of depth"):
        export(Path("9dtact"), tmp_path / "out", Format.TAXIM)
