"""The page that adds a sensor gives a file that is one."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from sim.sensor.sensor import load_sensor, parse_sensor

PAGE = Path(__file__).parents[3] / "docs" / "how-to" / "add-a-sensor.md"


def _file() -> str:
    return re.findall(r"```toml\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)[0]


def test_the_page_gives_a_sensor(tmp_path: Path) -> None:
    """The TOML on the page loads by its path as it stands."""
    path = tmp_path / "my-sensor.toml"
    path.write_text(_file(), encoding="utf-8")
    sensor = load_sensor(str(path))
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
