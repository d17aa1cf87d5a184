"""Sensor files: geometry, optics, and the page that says how to write one."""

from dataclasses import replace
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.sensor.camera_geometry import CameraGeometry
from sim.sensor.lamps_and_optics import parse_optics
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
    assert sensor.markers.columns == 9


def test_sensor_file_of_ones_own(tmp_path: Path) -> None:
    """A path works like a name."""
    path = tmp_path / "mine.toml"
    path.write_text(TEXT.replace('name = "gelsight-mini"', 'name = "mine"'), "utf-8")
    assert load_sensor(str(path)).name == "mine"
    path.write_bytes(b"name = '\xff'")
    with pytest.raises(ConfigError, match=r"mine\.toml: not valid TOML: 'utf-8'"):
        load_sensor(str(path))


@pytest.mark.parametrize(
    "line", ["pad = 3", "layers = 3", "layers = [3]", 'optics = "x"', "relaxation = { share = 1 }"]
)
def test_a_section_that_is_no_table_is_refused(line: str) -> None:
    """The message names the file and the key."""
    key, _ = line.split(" = ", 1)
    with pytest.raises(ConfigError, match=rf"mine\.toml: {key}.* is not a (table|list)") as caught:
        parse_sensor(f'name = "x"\ntitle = "y"\n{line}\n', origin="mine.toml")
    assert "sensor-file.md" in caught.value.remedy


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
    assert sensor.with_gel(relaxation=()) == parse_sensor(LAYERED, origin="mine.toml")


GEL = TEXT[TEXT.index("[material]") : TEXT.index("[camera]")]


@pytest.mark.parametrize(
    ("text", "old", "new", "message"),
    [
        (TEXT, "[pad]", "[pads]", "pads: unknown key; did you mean pad"),
        (TEXT, "poisson =", "poison =", "material.poison: unknown key; did you mean poisson"),
        (TEXT, '"4.00 mm"', '"4.00 N"', "pad.height.value"),
        (TEXT, "columns = 9", "columns = 0", "markers.columns"),
        (TEXT, 'title = "GelSight Mini"', "", "title: missing"),
        (TEXT, 'young = { value = "0.435 MPa", ', "young = { ", "young.value: missing; write for"),
        (TEXT, "[camera]", "[camera", "not valid TOML"),
        (TEXT, "columns = 9", "columns = true", "markers.columns"),
        (TEXT, 'kind = "photometric"', 'like = "radar"', 'optics.like: sensor "radar" is none of'),
        (LAYERED, 'value = "0.925"', 'value = "0.9"', "sum to .* not 1"),
        (LAYERED, "share =", "thickness =", r"layers\[0\].share: missing"),
        (LAYERED, "[[layers]]", "[[layer]]", "layer: unknown key; did you mean layers"),
        (LAYERED, "[camera]", f"{GEL}[camera]", "both material and layers"),
        (LAYERED, '{ value = "0.1 MPa"', '{ value = "0.1 mm"', r"layers\[0\].young.value"),
        (RELAXING, 'time = "0.3 s"', 'time = "0.3 mm"', r"relaxation\[0\].time"),
        (RELAXING, 'time = "3 s"', 'times = "3 s"', r"relaxation\[1\].time: missing"),
        (RELAXING, 'share = "3 %"', 'share = "-3 %"', "relaxation.1: .* term of share -0.03"),
        (RELAXING, 'share = "3 %"', 'share = "97 %"', "shares sum to 1.01"),
    ],
)
def test_broken_sensor_file_is_refused(text: str, old: str, new: str, message: str) -> None:
    """The message names the file, and the key, layer or term."""
    assert old in text
    with pytest.raises(ConfigError, match=message) as caught:
        parse_sensor(text.replace(old, new), origin="mine.toml")
    assert "mine.toml" in caught.value.message
    assert caught.value.remedy


LAMP = {"azimuth": "90 deg", "elevation": "20 deg", "colour": [80, 0, 0], "source": "assumed"}
GREY = {"kind": "grey-depth", "depth": ["0 mm", "1 mm"], "change": [0, -60], "source": "assumed"}


def test_built_in_sensors_have_optics() -> None:
    """Mini and DIGIT by lamps, DIGIT with shadows, 9DTact by a table that darkens."""
    mini, digit, tact = (load_sensor(name).optics for name in ("gelsight-mini", "digit", "9dtact"))
    assert len(mini.lamps) == len(digit.lamps) == 3
    assert load_sensor("taxim-gelsight").optics == mini
    assert mini.shadows is None
    assert digit.shadows is not None
    assert tact.table["kind"] == "grey-depth"
    assert list(tact.model.change) == sorted(tact.model.change, reverse=True)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"optics": {"kind": "radar"}}, '"radar" is none of "photometric", "grey-depth"'),
        ({"optics": {"kind": "grey-depth"}}, "missing or unknown change, depth, source"),
        ({"optics": {**GREY, "change": [0]}}, "are no table"),
        ({"optics": {**GREY, "depth": ["0 mm", "0 mm"]}}, "are no table"),
        ({"optics": {**GREY, "depth": ["0 mm", "1"]}}, "has no unit"),
        ({"optics": {"kind": "photometric", "shadow_softness": "0.1 mm"}}, "at least one lamp"),
        ({"lamps": [{"azimuth": "1 deg"}]}, "lamp 1 needs azimuth, elevation"),
        ({"lamps": [{**LAMP, "azimuth": 90}]}, "has no unit"),
        ({"lamps": [{**LAMP, "colour": [80, 0]}]}, "lamp 1 colour = .* no list of 3 grey levels"),
        ({"lamps": [{**LAMP, "colour": "red"}]}, "lamp 1 colour = 'red' is no list"),
        ({"lamps": [{**LAMP, "colour": [80, 0, float("nan")]}]}, "lamp 1 colour"),
        ({"optics": {**GREY, "change": ["dark", "darker"]}}, "optics.change = .* is no list"),
        ({"optics": {**GREY, "depth": 3}}, "are no table"),
    ],
)
def test_damaged_tables_are_refused(data: dict[str, object], message: str) -> None:
    """The file, the key and what to write are named."""
    with pytest.raises(ConfigError, match=message) as caught:
        parse_optics(data, "my.toml")
    assert "my.toml" in caught.value.message
    assert caught.value.remedy


def test_shadows_are_read() -> None:
    """A softness with lamps switches shadows on; without it they are off."""
    table = {"kind": "photometric", "shadow_softness": "0.1 mm"}
    read = parse_optics({"optics": table, "lamps": [LAMP]}, "my.toml")
    assert read.shadows.softness_m == pytest.approx(1e-4)
    assert parse_optics({"lamps": [LAMP]}, "my.toml").shadows is None


EXAMPLE = Path(__file__).parents[3] / "docs" / "examples" / "my-sensor.toml"


def _file() -> str:
    return EXAMPLE.read_text("utf-8")


def test_the_page_gives_a_sensor() -> None:
    """Its example loads by its path as it stands."""
    sensor = load_sensor(str(EXAMPLE))
    assert sensor.pad.height_m == pytest.approx(3e-3)
    assert len(sensor.optics.lamps) == 3


def test_the_pages_variants_load() -> None:
    """Markers, shadows and grey depth go in where the page says."""
    length = '{{ value = "{} mm", uncertainty = "0.1 mm", source = "x" }}'
    sizes = "".join(
        f"{key} = {length.format(value)}\n"
        for key, value in (("pitch_x", 2.4), ("pitch_y", 2.4), ("radius", 0.4))
    )
    markers = parse_sensor(
        f"{_file()}\n[markers]\ncolumns = 5\nrows = 4\n{sizes}", origin="page"
    ).markers
    assert markers is not None
    assert markers.columns == 5
    kind = 'kind = "photometric"'
    shady = _file().replace(kind, f'{kind}\nshadow_softness = "0.08 mm"\nsource = "x"')
    assert parse_sensor(shady, origin="page").optics.shadows.softness_m == pytest.approx(8e-5)
    grey = (
        _file()
        .split("[[lamps]]")[0]
        .replace(
            kind,
            'kind = "grey-depth"\ndepth = ["0 mm", "0.5 mm", "1 mm"]\n'
            'change = [0, -40, -60]\nsource = "x"',
        )
    )
    assert parse_sensor(grey, origin="page").optics.model.change == (0.0, -40.0, -60.0)


MINI = CameraGeometry.centred(320, 240, scale_x_m=6.34e-5, scale_y_m=6.5e-5)


@given(
    rotation=st.floats(-3.1, 3.1),
    mirrored=st.booleans(),
    column=st.floats(-50, 400),
    row=st.floats(-50, 400),
)
def test_pixel_to_pad_and_back(rotation: float, mirrored: bool, column: float, row: float) -> None:
    """The two maps are each other's inverse for every rotation and mirroring."""
    geometry = replace(MINI, rotation_rad=rotation, mirrored=mirrored)
    pixel = np.array([column, row])
    np.testing.assert_allclose(geometry.to_pixels(geometry.to_pad(pixel)), pixel, atol=1e-9)


def test_scales_of_columns_and_rows_differ() -> None:
    """One column is scale_x and one row scale_y from the centre."""
    pad = MINI.to_pad(np.array([[160.5, 119.5], [159.5, 120.5]]))
    np.testing.assert_allclose(pad, [[6.34e-5, 0.0], [0.0, 6.5e-5]], atol=1e-15)


def test_mirrored_rows_grow_with_minus_y() -> None:
    """A mirrored camera sees +y above the centre."""
    y = replace(MINI, mirrored=True).pad_grid()[1]
    assert y[0, 0] == pytest.approx(119.5 * 6.5e-5)


@pytest.mark.parametrize(
    ("field", "value"), [("width", 0), ("scale_x_m", 6.34), ("crop_fraction", 0.5)]
)
def test_impossible_geometry_is_refused(field: str, value: float) -> None:
    """Millimetres given as metres, empty images and full crops are refused by name."""
    with pytest.raises(ConfigError, match=field.removesuffix("_m")):
        replace(MINI, **{field: value})  # type: ignore[arg-type]


def test_where_the_pads_centre_is_seen() -> None:
    """From the image's middle, to the right and down; in the middle it is nought."""
    assert MINI.centre_from_middle_m == pytest.approx((0.0, 0.0), abs=1e-5)
    moved = replace(MINI, centre_x_px=MINI.centre_x_px + 10.0, centre_y_px=MINI.centre_y_px - 4.0)
    x, y = moved.centre_from_middle_m
    assert x - MINI.centre_from_middle_m[0] == pytest.approx(10.0 * MINI.scale_x_m)
    assert y - MINI.centre_from_middle_m[1] == pytest.approx(-4.0 * MINI.scale_y_m)
