"""Numbers with units: every way of writing one, and every way of getting it wrong."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.quantities import UNITS, Dimension, example, parse_quantity

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
