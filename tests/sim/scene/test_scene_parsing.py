"""Pads, indenters, contacts, layers and mesh settings as text."""

from collections.abc import Callable

import pytest

from sim.scene.indenter import Cylinder, Plane, Sphere
from sim.scene.material import LawName, Layer, Material
from sim.scene.pad import BoxPad, DiscPad
from sim.scene.scene import ContactMode, TetWildOptions, parse_tetwild_options
from sim.scene.scene_parsing import parse_contact, parse_indenter, parse_layer, parse_pad
from tacauchy_rig.core.errors import ConfigError


def layer(text: str) -> Layer:
    """Read a layer of the linear law."""
    return parse_layer(text, law=LawName.LINEAR)


SKIN = Material(young_pa=1e5, poisson=0.48, law=LawName.LINEAR)


@pytest.mark.parametrize(
    ("read", "text", "expected"),
    [
        (parse_pad, "box:20x25x4mm", BoxPad(size_x_m=20e-3, size_y_m=25e-3, height_m=4e-3)),
        (parse_pad, "disc:radius=12mm,height=4.5mm", DiscPad(radius_m=12e-3, height_m=4.5e-3)),
        (
            parse_indenter,
            "cylinder:diameter=5mm,fillet=0.1mm",
            Cylinder(diameter_m=5e-3, fillet_m=1e-4),
        ),
        (parse_indenter, "sphere:diameter=15mm", Sphere(diameter_m=0.015)),
        (parse_indenter, "plane", Plane()),
        (parse_contact, "bonded", (ContactMode.BONDED, 0.0)),
        (parse_contact, "friction:0.5", (ContactMode.FRICTION, 0.5)),
        (layer, "share=0.925,young=0.1MPa,poisson=0.48", Layer(share=0.925, material=SKIN)),
        (parse_tetwild_options, "l_r=0.08", TetWildOptions(l_r=0.08)),
    ],
)
def test_what_is_stated_is_read(read: Callable[[str], object], text: str, expected: object) -> None:
    """Sizes come by name, or with one unit for all; they are SI inside."""
    assert read(text) == expected


def test_an_angle_has_its_unit() -> None:
    """What is not stated stays the preset's."""
    tetwild = parse_tetwild_options("dihedral_min=5deg")
    assert tetwild.dihedral_min_rad == pytest.approx(0.0872664626)
    assert tetwild.stop_energy is None


@pytest.mark.parametrize(
    ("read", "text", "message"),
    [
        (parse_indenter, "ball:diameter=5mm", "no such indenter"),
        (parse_indenter, "cylinder:radius=5mm", "unknown size 'radius'"),
        (parse_indenter, "cylinder:diameter=5", "has no unit"),
        (parse_indenter, "sphere", "no diameter"),
        (parse_pad, "box:20x20mm", "three sizes"),
        (parse_pad, "box:20x20x4", "has no unit"),
        (parse_pad, "cube:4mm", "no such pad"),
        (parse_pad, "disc:radius=3mm", "no height"),
        (parse_pad, "mesh:gel.stl", "its unit is not said"),
        (parse_pad, "mesh:gel.stl,unit=mile", "no such unit 'mile'"),
        (parse_indenter, "mesh:part.stl,unit=mile", "no such unit 'mile'"),
        (parse_pad, "mesh:gel.stl,unit=mm", "gel.stl cannot be read"),
        (parse_pad, "mesh:gel.step,unit=mm", "exact surfaces"),
        (layer, "", "--layer: no share"),
        (layer, "share=0.9", "--layer: no young"),
        (layer, "share=0.9,young=0.1MPa,poisson=0.48,law=x", "--layer: unknown size 'law'"),
        (layer, "share=0.9,young=1,poisson=0", "--layer young.* has no unit"),
        (parse_tetwild_options, "edge=1mm", "unknown mesh setting edge"),
        (parse_tetwild_options, "l_r=3", "l_r = 3"),
        (parse_tetwild_options, "epsilon_r=0.1", "epsilon_r = 0.1"),
        (parse_tetwild_options, "stop_energy=2", "stop_energy = 2"),
        (parse_tetwild_options, "dihedral_min=60deg", "dihedral_min_rad = 1.0"),
    ],
)
def test_what_is_wrong_is_explained(read: Callable[[str], object], text: str, message: str) -> None:
    """The message names what is wrong with the text."""
    with pytest.raises(ConfigError, match=message):
        read(text)
