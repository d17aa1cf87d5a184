"""Pads from triangle files: what is read, what is refused, and that they press like the formula."""

from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from sim.effects.mesh_choice import MeshKind, footprint_mesh, mesh_choice
from sim.effects.presets import build_model
from sim.mesh.tetwild import pad_surface
from sim.scene.indenter import Sphere
from sim.scene.material import Layer, Material
from sim.scene.pad import BoxPad, covers, read_surface_pad, surface_pad
from sim.scene.scene import Preset, Scene, Target
from sim.scene.triangle_surface import MeshUnit
from sim.sensor.sensor import parse_sensor
from sim.solve.loading_path import LoadingPath
from tacauchy_rig.core.arrays import FloatArray, IntArray
from tacauchy_rig.core.errors import ConfigError

DOMED = BoxPad(
    size_x_m=12e-3, size_y_m=10e-3, height_m=4e-3, dome_radius_x_m=0.06, dome_radius_y_m=0.09
)
TEXT = resources.files("sim.sensor.files").joinpath("gelsight-mini.toml").read_text("utf-8")


def write_stl(path: Path, vertices: FloatArray, faces: IntArray, *, unit_m: float = 1e-3) -> Path:
    """Write triangles as a binary STL file."""
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    rows = np.zeros(len(faces), dtype=record)
    rows["corners"] = (vertices / unit_m)[faces]
    path.write_bytes(b"\0" * 80 + np.uint32(len(faces)).tobytes() + rows.tobytes())
    return path


def dome() -> tuple[FloatArray, IntArray]:
    """Return the domed pad's triangles."""
    return pad_surface(DOMED, spacing_m=0.5e-3)


@pytest.mark.parametrize("inside_out", [False, True])
def test_file_gives_the_shape(tmp_path: Path, inside_out: bool) -> None:
    """Moved anywhere in the file, the pad stands centred on z = 0 with the formula's height."""
    vertices, faces = dome()
    moved = vertices + np.array([5e-3, -2e-3, 7e-3])
    path = write_stl(tmp_path / "gel.stl", moved, faces[:, :: -1 if inside_out else 1])
    pad = read_surface_pad(path, unit=MeshUnit.MILLIMETRE)
    assert pad.half_extents() == pytest.approx(DOMED.half_extents(), abs=1e-8)
    assert pad.height_m == pytest.approx(DOMED.height_m, abs=1e-6)
    x, y = np.meshgrid(np.linspace(-5.5e-3, 5.5e-3, 12), np.linspace(-4.5e-3, 4.5e-3, 12))
    np.testing.assert_allclose(pad.height_at(x, y), DOMED.height_at(x, y), atol=2e-6)
    plan = np.array([[0.0, 0.0], [5.9e-3, -4.9e-3], [6.1e-3, 0.0]])
    assert covers(pad, plan).tolist() == [True, True, False]
    again = read_surface_pad(path, unit=MeshUnit.MILLIMETRE)
    assert pad == again
    assert repr(pad) == repr(again)


def test_bad_surfaces_are_refused(tmp_path: Path) -> None:
    """Open, upside down, on its side, in the wrong unit, or no triangles at all."""
    vertices, faces = dome()
    with pytest.raises(ConfigError, match="pad gel is not closed"):
        surface_pad(vertices, faces[1:], name="gel")
    with pytest.raises(ConfigError, match="no flat base"):
        surface_pad(vertices * [1.0, -1.0, -1.0], faces, name="gel")
    with pytest.raises(ConfigError, match="no higher than wide"):
        surface_pad(vertices[:, [1, 2, 0]], faces, name="gel")
    path = write_stl(tmp_path / "gel.stl", vertices, faces)
    with pytest.raises(ConfigError, match="which is no pad's size") as caught:
        read_surface_pad(path, unit=MeshUnit.METRE)
    assert "unit" in caught.value.remedy
    with pytest.raises(ConfigError, match="exact surfaces") as caught:
        read_surface_pad(tmp_path / "gel.step", unit=MeshUnit.MILLIMETRE)
    assert "export" in caught.value.remedy
    with pytest.raises(ConfigError, match="cannot be read"):
        read_surface_pad(tmp_path / "none.stl", unit=MeshUnit.MILLIMETRE)


@pytest.mark.slow
def test_press_into_a_file_is_that_into_the_formula(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The domed pad from its STL file carries the parametric one's force within the mesh error."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    pad = read_surface_pad(write_stl(tmp_path / "gel.stl", *dome()), unit=MeshUnit.MILLIMETRE)
    forces = []
    for shape in (DOMED, pad):
        scene = Scene(
            pad=shape,
            material=Material(young_pa=4e5, poisson=0.4),
            indenter=Sphere(diameter_m=8e-3),
            target=Target(depth_m=0.2e-3),
            preset=Preset.FAST,
        )
        model = build_model(scene, mesh=footprint_mesh(scene, refinement=1.5))
        forces.append(LoadingPath(model, scene.indenter).advance(0.2e-3).force_n[2])
    assert mesh_choice(scene)[0] is MeshKind.FOOTPRINT
    # Another mesh, and by fTetWild another one every time.
    assert forces[1] == pytest.approx(forces[0], rel=0.015)


def test_layers_of_a_file_are_refused() -> None:
    """They are not meshed, and the message says so."""
    pad = surface_pad(*dome(), name="gel")
    material = Material(young_pa=4e5, poisson=0.4)
    scene = Scene(
        pad=pad,
        material=material,
        layers=(Layer(share=0.5, material=material), Layer(share=0.5, material=material)),
        indenter=Sphere(diameter_m=8e-3),
        target=Target(depth_m=0.3e-3),
    )
    with pytest.raises(ConfigError, match="layers of such a pad"):
        build_model(scene)


def sensor_text(pad: str) -> str:
    """Return a sensor file with another section [pad]."""
    before, after = TEXT.split("[pad]")
    return f"{before}[pad]\n{pad}\n\n[material]{after.split('[material]')[1]}"


def test_sensor_names_a_surface(tmp_path: Path) -> None:
    """The path starts at the sensor file, and the mesh settings are read."""
    write_stl(tmp_path / "gel.stl", *dome())
    text = sensor_text('surface = "gel.stl"\nunit = "mm"\nsource = "drawn"')
    text += '\n[mesh]\nl_r = 0.1\nepsilon_r = 1e-3\nstop_energy = 8\ndihedral_min = "4 deg"\n'
    sensor = parse_sensor(text, origin="mine.toml", folder=tmp_path)
    assert sensor.pad.height_m == pytest.approx(4e-3, abs=1e-6)
    assert sensor.tetwild.l_r == pytest.approx(0.1)
    assert sensor.tetwild.stop_energy == pytest.approx(8.0)
    assert sensor.tetwild.dihedral_min_rad == pytest.approx(np.radians(4.0))


@pytest.mark.parametrize(
    ("pad", "message"),
    [
        ('surface = "gel.stl"\nsource = "drawn"', "pad.unit: missing"),
        ('surface = "gel.stl"\nunit = "mm"', "pad.source: missing"),
        ('surface = "gel.stl"\nunit = "mile"\nsource = "drawn"', 'pad.unit: "mile" is none of'),
        ('surface = "no.stl"\nunit = "mm"\nsource = "drawn"', "cannot be read"),
        ('surface = "gel.stl"\nunit = "mm"\nsource = "drawn"\nheight = 3', "height: unknown key"),
    ],
)
def test_wrong_surface_sections_are_refused(tmp_path: Path, pad: str, message: str) -> None:
    """The message names the sensor file and the key."""
    write_stl(tmp_path / "gel.stl", *dome())
    with pytest.raises(ConfigError, match=message) as caught:
        parse_sensor(sensor_text(pad), origin="mine.toml", folder=tmp_path)
    assert "mine.toml" in caught.value.message
