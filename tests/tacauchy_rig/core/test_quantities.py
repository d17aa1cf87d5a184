"""Numbers with units, and what is chosen by name."""

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.scene.material import LawName
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.quantities import UNITS, Dimension, example, parse_quantity
from tacauchy_rig.core.registry import Kind, load, names, unknown

UNIT_OF = [(dimension, unit) for dimension, units in UNITS.items() for unit in units]


@given(
    number=st.floats(-1e12, 1e12),
    kind=st.sampled_from(UNIT_OF),
    space=st.sampled_from(["", " ", "   "]),
)
def test_what_is_written_is_parsed_back(
    number: float, kind: tuple[Dimension, str], space: str
) -> None:
    """A number written with all its digits comes back, in every unit."""
    dimension, unit = kind
    text = f"{number / UNITS[dimension][unit]:.17g}{space}{unit}"
    assert parse_quantity(text, dimension=dimension) == pytest.approx(number, rel=1e-14, abs=1e-300)


@pytest.mark.parametrize(
    ("text", "dimension", "value"),
    [
        ("5 mm", Dimension.LENGTH, 5e-3),
        ("0.3MPa", Dimension.PRESSURE, 3e5),
        ("  -400 mm ", Dimension.LENGTH, -0.4),
        ("+.5e-1 N", Dimension.FORCE, 0.05),
        ("3 %", Dimension.RATIO, 0.03),
        ("0.5", Dimension.RATIO, 0.5),
        ("180 deg", Dimension.ANGLE, math.pi),
        ("0.1 N m", Dimension.TORQUE, 0.1),
        ("2 min", Dimension.TIME, 120.0),
        ("25 fps", Dimension.FREQUENCY, 25.0),
        ("19.58px/mm", Dimension.IMAGE_SCALE, 19580.0),
    ],
)
def test_quantities_as_people_write_them(text: str, dimension: Dimension, value: float) -> None:
    """Spaces, signs, exponents and units with spaces are understood."""
    assert parse_quantity(text, dimension=dimension) == pytest.approx(value)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("5 N", '"5 N" has the unit "N"; a length needs one of: m, cm, mm, um'),
        ("5", '"5" has no unit; a length needs one of: m, cm, mm, um'),
        ("5 MM", '"5 MM" has the unit "MM"'),
        ("mm", '"mm" is not a number with a unit'),
        ("", '"" is not a number with a unit'),
        ("five mm", '"five mm" is not a number with a unit'),
        ("5,3 mm", '"5,3 mm" has a comma in its number; write a decimal point'),
        (" -,5 mm", '" -,5 mm" has a comma in its number; write a decimal point'),
        ("nan mm", '"nan mm" is not a number with a unit'),
        ("1e999 mm", '"1e999 mm" is not a finite number'),
    ],
)
def test_a_wrong_quantity_is_explained(text: str, problem: str) -> None:
    """The message has the field and the value, the remedy an example to copy."""
    with pytest.raises(ConfigError) as caught:
        parse_quantity(text, dimension=Dimension.LENGTH, field="indenter.diameter")
    assert caught.value.message.startswith(f"indenter.diameter: {problem}")
    assert caught.value.remedy.endswith('for example indenter.diameter = "5 mm"')


@given(text=st.text(max_size=12), dimension=st.sampled_from(Dimension))
def test_any_text_is_a_quantity_or_refused(text: str, dimension: Dimension) -> None:
    """No text gets through as something else than a finite number."""
    try:
        value = parse_quantity(text, dimension=dimension)
    except ConfigError:
        value = 0.0
    assert math.isfinite(value)


@pytest.mark.parametrize("dimension", list(Dimension))
def test_examples_are_valid(dimension: Dimension) -> None:
    """What a message offers to copy is accepted."""
    assert parse_quantity(example(dimension), dimension=dimension) > 0


def install(folder: Path, package: str, entries: str) -> None:
    """Put the metadata of a package into a folder of packages."""
    metadata = folder / f"{package.replace('-', '_')}-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(entries)


@pytest.mark.parametrize("kind", list(Kind))
def test_all_of_ours_import(kind: Kind) -> None:
    """No line of the table points nowhere."""
    assert names(kind)
    for name in names(kind):
        assert load(kind, name) is not None


def test_every_law_is_registered_by_its_own_name() -> None:
    """The names that sim knows are those of the registry, and each law says its own."""
    assert [name for name in names(Kind.LAW) if name in set(LawName)] == list(LawName)
    assert all(load(Kind.LAW, name).name == name for name in LawName)


def test_every_sensor_file_is_registered() -> None:
    """A file that nobody lists could not be found by name."""
    files = {load(Kind.SENSOR, name) for name in names(Kind.SENSOR)}
    assert files == set(next(iter(files)).parent.glob("*.toml"))


def test_an_unknown_name_is_answered_with_what_there_is() -> None:
    """The kind, the names, and where more would come from."""
    with pytest.raises(ConfigError, match='force sensor "ati" is none of "m3733c"') as caught:
        load(Kind.FORCE_SENSOR, "ati")
    assert "tacauchy_rig.force_sensors" in caught.value.remedy
    assert unknown(Kind.ARM, "ur5") == ""


def test_a_package_that_does_not_import_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever its code raises; and its name is still listed."""
    install(tmp_path, "broken-lab", "[tacauchy_rig.arms]\nfranka = broken_lab.arm:Franka\n")
    (tmp_path / "broken_lab").mkdir()
    (tmp_path / "broken_lab" / "arm.py").write_text("raise OSError('no libfranka')\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert names(Kind.ARM)[-1] == "franka"
    with pytest.raises(
        ConfigError, match=r'arm "franka" of the package broken-lab 1\.0 .* OSError: no libfranka'
    ):
        load(Kind.ARM, "franka")


def test_a_name_brought_twice_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Which of two packages is meant cannot be guessed."""
    install(tmp_path, "lab-a", "[tacauchy_rig.laws]\nogden = lab_a:LAW\n")
    install(tmp_path, "lab-b", "[tacauchy_rig.laws]\nogden = lab_b:LAW\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ConfigError, match=r'"ogden" is brought by both lab-. 1\.0 and lab-. 1\.0'):
        names(Kind.LAW)


def test_ours_cannot_be_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package that brings another ``ur5`` does not change which arm moves."""
    install(tmp_path, "lab-a", "[tacauchy_rig.arms]\nur5 = lab_a:Arm\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert load(Kind.ARM, "ur5").__module__ == "drivers.arm.ur5_motion_and_watchdog"
