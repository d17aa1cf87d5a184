"""Scenes as the words of a press, and back."""

from dataclasses import replace

import pytest

from sim.press_arguments import scene_from
from sim.scene.indenter import Sphere
from sim.scene.material import Layer, Material
from sim.scene.pad import BoxPad
from sim.scene.scene import ContactMode, Drive, Effect, Motion, Output, Preset, Scene, Target
from tacauchy_rig.core.errors import ConfigError


def test_digits_shifted_by_a_unit_are_exact() -> None:
    """What a page states in millimetres is the same press as one stated in metres."""
    scene = scene_from(
        "--pad box:20.1x19x3.3mm --layer share=0.7,young=0.29MPa,poisson=0.46 "
        "--layer share=0.3,young=0.41MPa,poisson=0.46 --indenter sphere:diameter=5.7mm "
        "--at 1.1,-0.7mm --depth 0.35mm --contact friction:0.6 --effect friction=on "
        "--effect inertia=off --shift 0.3mm --duration 0.3ms --preset fast --drive search "
        "--output image --output markers"
    )
    skin = Material(young_pa=0.41e6, poisson=0.46)
    assert scene == Scene(
        pad=BoxPad(size_x_m=20.1e-3, size_y_m=19e-3, height_m=3.3e-3),
        material=skin,
        layers=(
            Layer(share=0.7, material=replace(skin, young_pa=0.29e6)),
            Layer(share=0.3, material=skin),
        ),
        indenter=Sphere(diameter_m=5.7e-3),
        centre_m=(1.1e-3, -0.7e-3),
        target=Target(depth_m=0.35e-3),
        contact=ContactMode.FRICTION,
        friction=0.6,
        effects=((Effect.FRICTION, True), (Effect.INERTIA, False)),
        motion=Motion(shift_m=(0.3e-3, 0.0)),
        duration_s=3e-4,
        preset=Preset.FAST,
        drive=Drive.SEARCH,
        outputs=frozenset({Output.IMAGE, Output.MARKERS}),
    )
    assert replace(scene, preset="fast", drive="search", contact="friction").has_wide_barrier
    with pytest.raises(ConfigError, match="preset 'best' is none"):
        replace(scene, preset="best")


def test_words_that_state_no_scene_are_refused() -> None:
    """Neither pad nor sensor, an unknown option, an option without its value."""
    with pytest.raises(ConfigError, match="either --sensor or --pad"):
        scene_from("--indenter plane --depth 1mm")
    for words, problem in (
        ("--sensor digit --indenter plane --dept 1mm", "dept"),
        ("--sensor digit --indenter plane --depth", "--depth has no value"),
        ("--sensor digit --depth 1mm", "1mm: missing .*'indenter'"),
        ("--sensor 'digit --depth 1mm", "No closing quotation"),
        ("--sensor digit --indenter plane --depth 1mm --preset best", "best"),
    ):
        with pytest.raises(ConfigError, match=problem):
            scene_from(words)
