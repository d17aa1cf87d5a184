"""A known weight on cells that lie: each is refused, and the likely cause is named first."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.force_check import ForceCheck, Weight, judge_weight, parse_weight
from tacauchy_rig.core.run import Tare, Vector3

WEIGHT = Weight(mass_kg=0.2, uncertainty_kg=0.002)
BIAS: Vector3 = (0.3, -0.2, 1.4)


def tare(change: Vector3 = (0.0, 0.0, 0.0), *, noise_n: float = 0.004) -> Tare:
    """Return what the cell reads with its bias and a change [N]."""
    fx, fy, fz = (bias + added for bias, added in zip(BIAS, change, strict=True))
    return Tare(
        start_ns=0,
        end_ns=1,
        mean=(fx, fy, fz, 0.0, 0.0, 0.0),
        deviation=(noise_n,) * 6,
        sample_count=200,
    )


def judged(
    change: Vector3, *, sign: int = 1, drift_n: float = 0.0, noise_n: float = 0.004
) -> ForceCheck:
    """Judge a raw change of the cell under the weight [N]."""
    return judge_weight(
        WEIGHT,
        before=tare(noise_n=noise_n),
        loaded=tare((change[0], change[1], change[2] + 0.5 * drift_n), noise_n=noise_n),
        after=tare((0.0, 0.0, drift_n), noise_n=noise_n),
        compression_sign=sign,
        checked="2026-01-01T00:00:00+00:00",
    )


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("scale", [0.96, 1.0, 1.04])
def test_a_cell_that_reads_the_weight_passes(scale: float, sign: int) -> None:
    """A few per cent are the cell's and the weight's own; bias and mounting do not count."""
    check = judged((0.03, -0.02, -sign * scale * WEIGHT.force_n), sign=sign)
    assert check.passed
    assert check.ratio == pytest.approx(scale)


@pytest.mark.parametrize(
    ("scale", "cause"),
    [
        (0.1, "a tenth"),
        (1.0 / 9.81, "kgf"),
        (10.0, "ten times"),
        (0.2248, "pounds-force"),
        (4.448, "pounds-force"),
        (0.5, "half of what the sheet says"),
        (2.0, "twice what the sheet says"),
        (0.85, "compare range, gain"),
        (1.15, "weigh the weight again"),
    ],
)
def test_a_wrong_scale_names_what_makes_it(scale: float, cause: str) -> None:
    """The ratio tells range, unit or gain."""
    check = judged((0.0, 0.0, -scale * WEIGHT.force_n))
    assert not check.passed
    assert cause in check.remedy
    assert f"{scale:.3g} of that" in check.finding


def test_a_wrong_sign_names_the_field() -> None:
    """What hangs pulls: a cell that calls it pressing has the other sign."""
    check = judged((0.0, 0.0, WEIGHT.force_n))
    assert "force_sensor.compression_sign" in check.remedy.split(";")[0]


def test_sign_and_scale_are_told_together() -> None:
    """One check is enough to mend both."""
    remedy = judged((0.0, 0.0, 0.1 * WEIGHT.force_n)).remedy
    assert "compression_sign" in remedy
    assert "a tenth" in remedy


@pytest.mark.parametrize("change", [(-1.962, 0.0, 0.0), (0.0, 1.962, 0.0), (-1.5, 0.0, -1.2)])
def test_a_swapped_axis_names_mounting_and_matrix(change: Vector3) -> None:
    """A weight that is felt sideways hangs on a cell that is turned or decoupled wrongly."""
    assert "AT+DCPM" in judged(change).remedy


def test_a_part_that_goes_sideways_is_refused() -> None:
    """The scale alone is right, and a quarter more is felt across the axis."""
    remedy = judged((0.5, 0.0, -WEIGHT.force_n)).remedy
    assert remedy.startswith("0.500 N of it went sideways")


def test_a_stuck_cell_is_named() -> None:
    """A live cell has noise, whatever hangs on it."""
    assert judged((0.0, 0.0, 0.0), noise_n=0.0).remedy.startswith("the cell has no noise")


def test_nothing_felt_asks_for_the_weight_first() -> None:
    """Most often nobody hung it."""
    assert "did the weight hang" in judged((0.0, 0.0, -0.01)).remedy


@pytest.mark.parametrize("doubt", [{"drift_n": 0.5}, {"noise_n": 0.15}])
def test_what_wanders_is_not_judged(doubt: dict[str, float]) -> None:
    """Drift or a swinging weight leave a right cell unjudged, and say so."""
    check = judged((0.0, 0.0, -WEIGHT.force_n), **doubt)
    assert check.remedy.startswith("drift and noise leave")


@pytest.mark.parametrize("drift_n", [-1.962, 1.962])
def test_a_weight_that_stayed_or_hung_too_early_is_told(drift_n: float) -> None:
    """Two zeros that differ by the weight are no drift."""
    check = judged((0.0, 0.0, -0.5 * WEIGHT.force_n), drift_n=drift_n)
    assert check.remedy.startswith(f"unloaded again the cell is {drift_n:+.3f} N off")


@given(scale=st.floats(0.9, 1.1), drift_n=st.floats(-0.15, 0.15))
def test_the_tolerance_is_what_it_says(scale: float, drift_n: float) -> None:
    """A cell passes just where it is within the stated tolerance, whatever its zero drifts."""
    check = judged((0.0, 0.0, -scale * WEIGHT.force_n), drift_n=drift_n)
    assert check.measured_n == pytest.approx(-scale * WEIGHT.force_n)
    assert check.passed == (abs(check.measured_n - check.expected_n) <= check.tolerance_n)
    assert check.tolerance_n <= 0.05 * WEIGHT.force_n + math.hypot(0.0197, 0.0081, 0.0751)


@pytest.mark.parametrize(
    ("text", "mass_kg", "uncertainty_kg"),
    [("200g", 0.2, 0.002), ("0.5 kg +- 1 g", 0.5, 0.001), ("100 g ± 0.5 g", 0.1, 0.0005)],
)
def test_a_weight_is_read(text: str, mass_kg: float, uncertainty_kg: float) -> None:
    """With its own uncertainty, or one per cent."""
    weight = parse_weight(text)
    assert (weight.mass_kg, weight.uncertainty_kg) == pytest.approx((mass_kg, uncertainty_kg))


@pytest.mark.parametrize("text", ["200", "2 N", "1 g", "20 kg", "-200g", "", "200g+-much"])
def test_what_is_no_weight_is_refused(text: str) -> None:
    """The option is named."""
    with pytest.raises(ConfigError, match=r"--check-weight"):
        parse_weight(text)
