"""Closed triangle surfaces, and turned indenters."""

from pathlib import Path

import numpy as np
import pytest

from sim.scene.indenter import (
    Cylinder,
    Indenter,
    Plane,
    Sphere,
    TurnedIndenter,
    cylinder_triangles,
    tilted,
)
from sim.scene.triangle_surface import MeshUnit, closed_surface, read_triangles
from tacauchy_rig.core.errors import ConfigError

CORNERS = np.array([[0.0, 0.0, 0.0], [1.25, 0.0, 0.0], [0.0, 2.5, 0.0], [0.0, 0.0, 0.123456789012]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def binary_stl(header: bytes = b"") -> bytes:
    """Return the tetrahedron as binary STL."""
    rows = np.zeros(len(FACES), dtype=RECORD)
    rows["corners"] = CORNERS[FACES]
    return header.ljust(80, b"\0") + np.uint32(len(FACES)).tobytes() + rows.tobytes()


def text_stl() -> bytes:
    """Return the tetrahedron as text."""
    facets = [
        "facet normal 0 0 0\nouter loop\n"
        + "".join("vertex {:.15g} {:.15g} {:.15g}\n".format(*CORNERS[corner]) for corner in face)
        + "endloop\nendfacet\n"
        for face in FACES
    ]
    return ("solid part\n" + "".join(facets) + "endsolid part\n").encode()


def obj(faces: str = "f 1 3 2\nf 1//1 2//1 4//1\nf -3 -2 -1\nf 3 1 4\n") -> bytes:
    """Return the tetrahedron as OBJ, corners named in every way."""
    corners = "".join("v {:.15g} {:.15g} {:.15g}\n".format(*corner) for corner in CORNERS)
    return (corners + "vn 0 0 1\n" + faces).encode()


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("part.stl", binary_stl()),
        ("solid.stl", binary_stl(b"solid that is binary")),
        ("text.STL", text_stl()),
        ("part.obj", obj()),
    ],
)
def test_every_form_gives_the_same_triangles(tmp_path: Path, name: str, data: bytes) -> None:
    """Order and orientation stay; STL is of single precision, OBJ of double."""
    (tmp_path / name).write_bytes(data)
    vertices, faces = read_triangles(tmp_path / name, MeshUnit.METRE)
    rounding = 0.0 if name.endswith("obj") else 1e-7
    np.testing.assert_allclose(vertices[faces], CORNERS[FACES], rtol=rounding, atol=0.0)


def test_polygons_are_cut_into_triangles(tmp_path: Path) -> None:
    """A square keeps its area and its side."""
    path = tmp_path / "square.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n", "ascii")
    vertices, faces = read_triangles(path, MeshUnit.METRE)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    np.testing.assert_allclose(np.cross(b - a, c - a).sum(axis=0), [0.0, 0.0, 2.0])


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("gel.stl", None, r"gel\.stl cannot be read"),
        ("part.step", b"", "'?.step is no kind of triangle file"),
        ("short.stl", binary_stl()[:-60], "damaged or no STL file"),
        ("long.stl", binary_stl() + b"more", "damaged or no STL file"),
        ("text.stl", text_stl()[:150], "damaged or no STL file"),
        ("nan.stl", text_stl().replace(b"vertex 1.25", b"vertex nan"), "not finite|damaged"),
        ("empty.stl", b"\0" * 84, "holds no triangle"),
        ("empty.obj", b"", "holds no triangle"),
        ("letters.obj", obj().replace(b"v 1.25", b"v one"), "damaged or no OBJ file.*L.2"),
        ("corner.obj", obj("f 1 2 9\n"), "a corner names vertex 9 of 4"),
    ],
)
def test_missing_and_damaged_files_are_refused(
    tmp_path: Path, name: str, data: bytes | None, message: str
) -> None:
    """The file, what is wrong with it, and a remedy."""
    if data is not None:
        (tmp_path / name).write_bytes(data)
    with pytest.raises(ConfigError, match=message) as caught:
        read_triangles(tmp_path / name, MeshUnit.METRE)
    assert name in caught.value.message
    assert caught.value.remedy


PUNCH = Cylinder(diameter_m=5e-3, fillet_m=0.4e-3)


@pytest.mark.parametrize("indenter", [PUNCH, Cylinder(diameter_m=4e-3)])
def test_a_cylinder_of_triangles_is_closed_and_has_its_volume(indenter: Cylinder) -> None:
    """Outward triangles around pi r^2 l, less what the fillet and the polygon take off."""
    vertices, faces = cylinder_triangles(indenter)
    surface = closed_surface(vertices, faces, name="cylinder")
    a, b, c = (surface.vertices[surface.faces[:, k]] for k in range(3))
    volume = float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0
    full = np.pi * indenter.radius_m**2 * 2.0 * indenter.diameter_m
    assert 0.985 * full < volume < full


@pytest.mark.parametrize("indenter", [PUNCH, Sphere(diameter_m=6e-3), Plane()])
def test_an_upright_body_is_the_body_itself(indenter: Indenter) -> None:
    """No rotation changes nothing, and a tiny one next to nothing."""
    x, y = np.meshgrid(np.linspace(-1.5e-3, 1.5e-3, 9), np.linspace(-1.5e-3, 1.5e-3, 9))
    rest = indenter.lower_surface(x, y)
    upright = TurnedIndenter(indenter=indenter, rotation=np.eye(3))
    np.testing.assert_array_equal(upright.lower_surface(x, y), rest)
    leaning = TurnedIndenter(indenter=indenter, rotation=tilted(1e-6, 0.0))
    # Of triangles, a fillet of 0.4 mm is off by its chords: 0.4 mm (1 - cos(pi / 32)) = 2 um.
    np.testing.assert_allclose(leaning.lower_surface(x, y), rest, atol=2.2e-6)


def test_a_tilted_flat_end_rises_as_its_plane() -> None:
    """About y by an angle: the end falls along +x by its tangent."""
    angle = np.radians(5.0)
    turned = TurnedIndenter(indenter=PUNCH, rotation=tilted(0.0, angle))
    x = np.linspace(-1e-3, 1e-3, 5)
    expected = -np.tan(angle) * x
    np.testing.assert_allclose(turned.lower_surface(x, np.zeros(5)), expected, atol=1e-9)
    low, high = turned.reach()
    assert np.all(low < -PUNCH.radius_m * np.cos(angle) + 1e-4)
    assert np.all(high > PUNCH.radius_m * np.cos(angle) - 1e-4)
