"""Sensor files."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

import pytest

from sim.sensor.sensor import load_sensor, parse_sensor
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.registry import Kind, names

TEXT = resources.files("sim.sensor.files").joinpath("gelsight-mini.toml").read_text("utf-8")


def test_built_in_sensors_load() -> None:
    """All of them, each number with a source and an uncertainty."""
    ours = ["9dtact", "digit", "gelsight-mini"]
    assert names(Kind.SENSOR) == [*ours, "taxim-gelsight", "taxim-gelsight-mini"]
    for name in names(Kind.SENSOR):
        sensor = load_sensor(name)
        assert sensor.name == name
        assert all(n.source and n.uncertainty > 0.0 for n in sensor.numbers.values())


def test_gelsight_mini_is_what_was_measured() -> None:
    """The numbers of the one measured unit, in SI."""
    sensor = load_sensor("gelsight-mini")
    assert sensor.pad.size_x_m == pytest.approx(25.25e-3)
    assert sensor.pad.dome_radius_x_m == pytest.approx(0.185)
    assert sensor.material.young_pa == pytest.approx(0.435e6)
    assert sensor.material.poisson == pytest.approx(0.48)
    assert sensor.camera.scale_x_m == sensor.camera.scale_y_m == pytest.approx(63.4e-6)
    assert sensor.markers is not None
    assert sensor.markers.columns == 9


def test_sensor_file_of_ones_own(tmp_path: Path) -> None:
    """A path works like a name."""
    path = tmp_path / "mine.toml"
    path.write_text(TEXT.replace('name = "gelsight-mini"', 'name = "mine"'), "utf-8")
    assert load_sensor(str(path)).name == "mine"


@pytest.mark.parametrize(
    "line", ["pad = 3", "layers = 3", "layers = [3]", 'optics = "x"', "relaxation = { share = 1 }"]
)
def test_a_section_that_is_no_table_is_refused(line: str) -> None:
    """The message names the file and the key."""
    key, _ = line.split(" = ", 1)
    with pytest.raises(ConfigError, match=f"mine.toml: {key} is no table") as caught:
        parse_sensor(f'name = "x"\ntitle = "y"\n{line}\n', origin="mine.toml")
    assert key in str(caught.value.remedy)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[pad]", "[pads]", "unknown pads"),
        ("poisson =", "poison =", "unknown material.poison"),
        ('"4.00 mm"', '"4.00 N"', "pad.height.value"),
        ("columns = 9", "columns = 0", "markers.columns"),
        ('title = "GelSight Mini"', "", "no title"),
        ('young = { value = "0.435 MPa", ', "young = { ", "material.young needs"),
        ("[camera]", "[camera", "not TOML"),
    ],
)
def test_broken_sensor_file_is_refused(old: str, new: str, message: str) -> None:
    """The message names the file and the key."""
    with pytest.raises(ConfigError, match=message) as caught:
        parse_sensor(TEXT.replace(old, new), origin="mine.toml")
    assert "mine.toml" in caught.value.message
    assert caught.value.remedy


def test_unknown_sensor_lists_the_known() -> None:
    """A misspelt name gets the list."""
    with pytest.raises(ConfigError, match="neither built in") as caught:
        load_sensor("gelsight-maxi")
    assert "gelsight-mini" in caught.value.remedy


LAYERED = resources.files("sim.sensor.files").joinpath("9dtact.toml").read_text("utf-8")


def test_9dtact_has_a_stiffer_skin() -> None:
    """Two layers that fill the pad; the material is the one that is touched."""
    sensor = load_sensor("9dtact")
    base, skin = sensor.layers
    assert base.share + skin.share == pytest.approx(1.0)
    assert skin.share * sensor.pad.height_m == pytest.approx(0.3e-3)
    assert skin.material.young_pa > base.material.young_pa
    assert sensor.material == skin.material
    assert "layers.2.share" in sensor.numbers
    assert load_sensor("gelsight-mini").layers == ()


def test_stiffness_is_as_uncertain_as_the_worst_layer() -> None:
    """One number and its source, layered or not."""
    relative, source = load_sensor("9dtact").young_uncertainty()
    assert relative == pytest.approx(0.75)
    assert source == "assumed: stiffer than the base"
    assert load_sensor("gelsight-mini").young_uncertainty()[0] == pytest.approx(0.05 / 0.435)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('value = "0.925"', 'value = "0.9"', "sum to .* not 1"),
        ("share =", "thickness =", "layers.1 has thickness"),
        ("[[layers]]", "[[layer]]", "unknown layer"),
        ("[camera]", "[material]\n[camera]", "both material and layers"),
        ('{ value = "0.1 MPa"', '{ value = "0.1 mm"', "layers.1.young.value"),
    ],
)
def test_broken_layers_are_refused(old: str, new: str, message: str) -> None:
    """The message names the file and the layer."""
    with pytest.raises(ConfigError, match=message) as caught:
        parse_sensor(LAYERED.replace(old, new), origin="mine.toml")
    assert "mine.toml" in caught.value.message


RELAXING = (
    LAYERED
    + """
[[relaxation]]
share = "3 %"
time = "0.3 s"
source = "made up"

[[relaxation]]
share = "4 %"
time = "3 s"
source = "made up"
"""
)


def test_a_gel_relaxes_as_its_file_says() -> None:
    """All layers by the same terms; without any it is elastic."""
    sensor = parse_sensor(RELAXING, origin="mine.toml")
    terms = sensor.material.relaxation
    assert [(term.share, term.time_s) for term in terms] == [(0.03, 0.3), (0.04, 3.0)]
    assert all(layer.material.relaxation == terms for layer in sensor.layers)
    assert sensor.relaxing(()) == parse_sensor(LAYERED, origin="mine.toml")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('time = "0.3 s"', 'time = "0.3 mm"', "relaxation.1.time"),
        ('time = "3 s"', 'times = "3 s"', "relaxation.2 needs a share, a time"),
        ('share = "3 %"', 'share = "-3 %"', "relaxation.1: relaxation term of share -0.03"),
        ('share = "3 %"', 'share = "97 %"', "shares sum to 1.01"),
    ],
)
def test_a_broken_relaxation_is_refused(old: str, new: str, message: str) -> None:
    """The message names the file and the term."""
    with pytest.raises(ConfigError, match=message) as caught:
        parse_sensor(RELAXING.replace(old, new), origin="mine.toml")
    assert "mine.toml" in caught.value.message
