"""Pads, indenters and contacts as text."""

from __future__ import annotations

import pytest

from sim.scene.indenter import Cylinder, Plane, Sphere
from sim.scene.material import LawName
from sim.scene.pad import BoxPad, DiscPad
from sim.scene.scene import ContactMode
from sim.scene.terms import (
    parse_contact,
    parse_indenter,
    parse_layer,
    parse_pad,
)
from tacauchy_rig.core.errors import ConfigError


def test_box_with_one_unit_for_all_sizes() -> None:
    """The last size carries the unit of all three."""
    pad = parse_pad("box:20.75x25.25x4.5mm")
    assert isinstance(pad, BoxPad)
    assert (pad.size_x_m, pad.size_y_m, pad.height_m) == pytest.approx((20.75e-3, 25.25e-3, 4.5e-3))


def test_disc_and_indenters() -> None:
    """Sizes come by name and are SI inside."""
    disc = parse_pad("disc:radius=12mm,height=4.5mm")
    assert isinstance(disc, DiscPad)
    assert (disc.radius_m, disc.height_m) == pytest.approx((12e-3, 4.5e-3))
    cylinder = parse_indenter("cylinder:diameter=5mm,fillet=0.1mm")
    assert isinstance(cylinder, Cylinder)
    assert (cylinder.diameter_m, cylinder.fillet_m) == pytest.approx((5e-3, 1e-4))
    assert parse_indenter("sphere:diameter=15mm") == Sphere(diameter_m=0.015)
    assert parse_indenter("plane") == Plane()
    assert parse_contact("bonded") == (ContactMode.BONDED, 0.0)
    assert parse_contact("friction:0.5") == (ContactMode.FRICTION, 0.5)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("ball:diameter=5mm", "no such indenter"),
        ("cylinder:radius=5mm", "unknown size 'radius'"),
        ("cylinder:diameter=5", "has no unit"),
        ("sphere", "no diameter"),
    ],
)
def test_wrong_indenters_are_explained(text: str, message: str) -> None:
    """The message names what is wrong with the text."""
    with pytest.raises(ConfigError, match=message):
        parse_indenter(text)


@pytest.mark.parametrize("text", ["box:20x20mm", "box:20x20x4", "cube:4mm", "disc:radius=3mm"])
def test_wrong_pads_are_refused(text: str) -> None:
    """A pad without three sizes or without a unit is no pad."""
    with pytest.raises(ConfigError):
        parse_pad(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("mesh:gel.stl", "its unit is not said"),
        ("mesh:gel.stl,unit=mile", "no such unit 'mile'"),
        ("mesh:gel.stl,unit=mm", "gel.stl cannot be read"),
        ("mesh:gel.step,unit=mm", "exact surfaces"),
    ],
)
def test_wrong_pad_files_are_explained(text: str, message: str) -> None:
    """The message names the file and what is wrong with it."""
    with pytest.raises(ConfigError, match=message):
        parse_pad(text)


def test_layer_is_read_with_its_law() -> None:
    """Share, modulus and Poisson's ratio, in SI."""
    layer = parse_layer("share=0.925,young=0.1MPa,poisson=0.48", law=LawName.LINEAR)
    assert layer.share == pytest.approx(0.925)
    assert layer.material.young_pa == pytest.approx(1e5)
    assert (layer.material.poisson, layer.material.law) == (0.48, LawName.LINEAR)


@pytest.mark.parametrize(
    "text",
    ["", "share=0.9", "share=0.9,young=0.1MPa,poisson=0.48,law=x", "share=0.9,young=1,poisson=0"],
)
def test_incomplete_layers_are_refused(text: str) -> None:
    """A layer needs its three numbers, the modulus with a unit."""
    with pytest.raises(ConfigError, match="--layer"):
        parse_layer(text, law=LawName.LINEAR)
