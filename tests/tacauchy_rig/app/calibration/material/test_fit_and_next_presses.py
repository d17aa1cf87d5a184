"""A gel from presses: told within its intervals, written into its sensor's file, or refused."""

import re
from dataclasses import replace

import numpy as np
import pytest

from sim.scene.indenter import describe
from sim.sensor.sensor import parse_sensor
from tacauchy_rig.app.calibration.material.fit_and_next_presses import (
    MU,
    NU,
    YOUNG,
    Data,
    GelFit,
    Interval,
    contradictions,
    gel_to_write,
    next_presses,
    other_unit,
    predict_left_out,
)
from tacauchy_rig.app.calibration.material.relaxation_and_sensor_file import (
    fit_term,
    sensor_text,
    with_gel,
)
from tacauchy_rig.app.replay.simulator_inputs import ReplayInputs
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError
from tests.studies.gel import command as gels
from tests.tacauchy_rig.app.calibration.material.made_up import made_presses, made_response

GEL = {"young_pa": 5e5, "poisson": 0.465, "friction": 0.4}
BALL = {"power": 1.5, "confined": 2.0}
PUNCH = {"power": 1.1, "confined": 9.0}


def _data(*kinds: tuple[str, dict[str, float]], poisson: float = GEL["poisson"]) -> Data:
    gel = GEL | {"poisson": poisson}
    return [(made_presses(name, **gel, **kind), made_response(**kind)) for name, kind in kinds]


ONE = ("sphere:diameter=6mm", BALL)
OTHER = ("cylinder:diameter=8mm,fillet=0.5mm", PUNCH)


def test_two_indenters_tell_a_gel_and_their_zeros() -> None:
    """All within their intervals, the modulus to some per cent, a zero 40 um off to 10 um."""
    data = _data(ONE, OTHER)
    later = replace(data[0][0], depth_m=data[0][0].depth_m + 40e-6)
    fit = GelFit(data=[(later, data[0][1]), data[1]])
    young, poisson, friction = (fit.interval(place) for place in (YOUNG, NU, MU))
    assert young.holds(GEL["young_pa"])
    assert poisson.uncertainty
    assert poisson.holds(GEL["poisson"])
    assert friction.holds(GEL["friction"])
    assert (young.uncertainty or 1e9) < 0.05 * GEL["young_pa"]
    assert fit.zeros_m[0] == pytest.approx(-40e-6, abs=10e-6)


def test_one_indenter_tells_a_valley_and_an_assumed_ratio_picks_a_modulus() -> None:
    """Any nu does; along the valley E goes as the formula has it."""
    data = _data(ONE)
    fit = GelFit(data=data)
    poisson = fit.interval(NU)
    assert poisson.low is None
    assert poisson.high is None
    low, high = (fit.solve(fit.best, {NU: nu})[0][YOUNG] for nu in (0.42, 0.48))
    assert low - high == pytest.approx(2.0 * 0.06, abs=0.03)
    told = GelFit(data=data, priors={NU: (GEL["poisson"], 0.005)})
    assert told.interval(NU).uncertainty
    assert told.interval(YOUNG).holds(GEL["young_pa"])
    assert (told.interval(YOUNG).uncertainty or 1e9) < (fit.interval(YOUNG).uncertainty or 0.0)


def test_a_stated_ratio_that_the_forces_exclude_is_not_kept() -> None:
    """The file then has the nu that they leave possible, and a modulus that fits it."""
    fit = GelFit(data=_data(ONE, OTHER, poisson=0.362))
    file, young, nu = gel_to_write(fit, [fit.interval(place) for place in (YOUNG, NU, MU)])
    assert NU not in file.priors
    assert fit.interval(NU).low is None
    assert nu.uncertainty
    assert nu.holds(0.362)
    assert young.holds(GEL["young_pa"])


def test_what_another_law_changes_is_interpolated() -> None:
    """Between the solved depths and Poisson's ratios."""
    depth_m = np.array([2.5e-4, 7.5e-4])
    found = made_response(**PUNCH).changed_by_law(0.44, depth_m)
    np.testing.assert_allclose(found, 20.0 * depth_m, rtol=0.02)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_few_forces_fit_what_they_can(count: int) -> None:
    """A modulus for any nu; no contradiction that one force could show."""
    presses, response = _data(ONE)[0]
    names = ("press", "depth_m", "force_n", "noise_n")
    few = replace(presses, **{name: getattr(presses, name)[-count:] for name in names})
    fit = GelFit(data=[(few, response)])
    assert fit.interval(YOUNG).holds(GEL["young_pa"])
    assert not fit.interval(NU).uncertainty
    left_out = list(predict_left_out(fit))
    assert len(left_out) == (count if count > 1 else 0)
    assert not contradictions(fit, left_out)


def test_depths_that_count_from_a_force_are_shifted_by_what_the_gel_gives() -> None:
    """Without it the same forces need another zero of depth."""
    presses, response = _data(OTHER)[0]
    area = response.area_m2(0.465, 0.4, np.array([2e-5]))[0]
    later = replace(
        presses, contact_force_n=GEL["young_pa"] * float(area), depth_m=presses.depth_m - 2e-5
    )
    zero, shifted = (
        GelFit(data=[(each, response)]).zeros_m[0]
        for each in (later, replace(later, contact_force_n=0.0))
    )
    assert shifted - zero == pytest.approx(2e-5, abs=3e-6)


def _spoiled(data: Data, wrong: str) -> Data:
    (ball, ball_response), (punch, punch_response) = data
    force_n = punch.force_n.copy()
    force_n[4] *= 1.25
    changed = {
        "nothing": (ball, punch),
        "gram-force": tuple(replace(each, force_n=101.97 * each.force_n) for each in (ball, punch)),
        "zero": tuple(replace(each, depth_m=each.depth_m + 2e-4) for each in (ball, punch)),
        "label": (replace(ball, force_n=punch.force_n), replace(punch, force_n=ball.force_n)),
        "one force": (ball, replace(punch, force_n=force_n)),
    }[wrong]
    return list(zip(changed, (ball_response, punch_response), strict=True))


@pytest.mark.parametrize("wrong", ["nothing", "gram-force", "zero", "label", "one force"])
def test_wrong_data_are_refused_by_name(wrong: str) -> None:
    """A force that is a quarter too large is named first; right ones predict each other."""
    fit = GelFit(data=_spoiled(_data(ONE, OTHER), wrong))
    left_out = list(predict_left_out(fit))
    found = contradictions(fit, left_out)
    assert bool(found) == (wrong != "nothing")
    if wrong == "nothing":
        assert sum(each.held for each in left_out) >= 14
    if wrong == "gram-force":
        assert "; with forces in gf: 0." in found[0]
    if wrong == "zero":
        zeros = [each for each in found if "their zero is stated to 0.020 mm" in each]
        assert re.search(r"fit with -0\.(1\d|2)", zeros[0])
    if wrong == "one force":
        named = next(each for each in found if "where the others predict" in each)
        assert named.startswith("cylinder:diameter=8mm,fillet=0.5mm at 0.5 mm")


@pytest.mark.parametrize(("factor", "unit"), [(1.0, None), (1.0 / 9.80665, "kgf"), (1e3, "mN")])
def test_a_unit_that_explains_an_odd_modulus_is_named(factor: float, unit: str | None) -> None:
    """Kilogram-force gives a modulus that some gel has, and so does not contradict the data."""
    data = [(replace(p, force_n=factor * p.force_n), response) for p, response in _data(OTHER)]
    named = other_unit(GelFit(data=data))
    assert (named is None) == (unit is None)
    young = re.search(rf"{unit}: ([\d.]+) MPa", str(named))
    assert unit is None or (young and 0.2 < float(young[1]) < 2.0)  # one punch fits many


def test_the_next_press_is_the_one_that_reduces_most(monkeypatch: pytest.MonkeyPatch) -> None:
    """A punch that feels nu more than a ball, as deep as it feels it most."""

    def pressed(
        tool: ReplayInputs, _: GelFit, depths_m: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        nu = {"sphere": 2.0, "cylinder": 9.0}[describe(tool.indenter).partition(":")[0]]
        rise = depths_m / depths_m.max()
        return depths_m**1.5, np.stack([np.ones(4), nu * rise, 0.05 * rise], axis=1)

    monkeypatch.setattr(
        "tacauchy_rig.app.calibration.material.fit_and_next_presses._candidate", pressed
    )
    fit = GelFit(data=_data(ONE))
    found = next_presses(fit)
    assert len(found) == 5
    best, worst = found[0], found[-1]
    assert best.indenter.startswith("cylinder")
    assert worst.indenter.startswith("sphere")
    assert best.depth_m == pytest.approx(0.8e-3)
    assert best.left[NU] < 0.5 * best.now[NU]
    assert all(left <= now for each in found for left, now in zip(each.left, each.now, strict=True))


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_three_emulated_gels_under_a_ball() -> None:
    """Each E is in its interval, wrong data are refused; with one law forces are alike.

    What left-out forces miss, `python -m tests.studies gel` states.
    """
    gel = gels.drawn_gel(1, 0)
    response = gels.response_of(gels.BALL)
    of_law = 1.0 + response.changed_by_law(gel[1], gels.DEPTHS_M)
    off = of_law * response.area_m2(*gel[1:], gels.DEPTHS_M) / gels.true_areas(gels.BALL, gel)
    assert off == pytest.approx(1.0, abs=0.015)
    (row,) = gels.gel_table(
        {(gels.BALL,): [gels.judged_gel(1, k, (gels.BALL,)) for k in range(3)]}
    ).rows
    _, young, *_, accused, caught = map(str, row)
    assert young.startswith("3 of 3;")
    assert accused == "0"
    assert all(each.endswith(" 3") for each in caught.split(", ")), caught


TOLD = Interval(best=4.1e5, low=3.9e5, high=4.3e5)


def test_what_is_told_is_written_and_the_rest_stays() -> None:
    """The modulus with a standard uncertainty; Poisson's ratio, open above, as it was."""
    before = sensor_text("gelsight-mini")
    after = with_gel(
        before, young=TOLD, poisson=Interval(best=0.48, low=0.46, high=None), source="made up"
    )
    old, new = (parse_sensor(text, origin="made up") for text in (before, after))
    assert new.material.young_pa == pytest.approx(4.1e5)
    assert new.numbers["material.young"].uncertainty == pytest.approx(0.2e5 / 1.96, rel=0.05)
    assert new.numbers["material.young"].source == "made up"
    assert new.material.poisson == old.material.poisson
    assert len(set(before.splitlines()) ^ set(after.splitlines())) == 2


def test_a_file_without_such_a_line_is_refused() -> None:
    """A gel of layers, or one that is written otherwise."""
    with pytest.raises(ConfigError, match="0 lines"):
        with_gel("[material]\n", young=TOLD, poisson=TOLD, source="made up")


TIME_S = np.tile(np.linspace(0.0, 2.0, 200), 6)
NOISE = 0.002 * np.random.default_rng(3).standard_normal(len(TIME_S))


def test_share_and_time_are_found() -> None:
    """3 % in 0.4 s, under noise of 0.2 %."""
    found = fit_term(TIME_S, 1.0 + 0.03 * np.exp(-TIME_S / 0.4) + NOISE)
    assert found is not None
    assert found.share == pytest.approx(0.03, abs=3.0 * found.share_error)
    assert found.time_s == pytest.approx(0.4, abs=3.0 * found.time_error_s)
    assert found.share_error < 0.002


@pytest.mark.parametrize("rising", [0.0, 0.005])
def test_noise_and_a_rising_force_tell_none(rising: float) -> None:
    """A servo that still pushes is no relaxation."""
    assert fit_term(TIME_S, 1.0 + rising * TIME_S + NOISE) is None
    assert fit_term(TIME_S[:5], np.ones(5)) is None
