"""Keep, recalibrate or replace: one press beside one of before."""

from dataclasses import replace

import numpy as np
import pytest

from tacauchy_rig.app.gel_health import Advice, PressMeasures, compare_presses
from tacauchy_rig.core.errors import RecordError

DEPTH_M = np.linspace(0.0, 4e-4, 200)


def _press(*, factor=1.0, missed_m=0.0, seed=0):
    random = np.random.default_rng(seed)
    force_n = factor * (4e3 * DEPTH_M + 3e6 * DEPTH_M**2)
    unloaded = np.full((60, 80, 3), 100.0)
    pressed = unloaded.copy()
    pressed[20:40, 30:50] += 30.0
    return PressMeasures(
        depth_m=DEPTH_M + missed_m,
        force_n=force_n + random.normal(0.0, 0.008, len(DEPTH_M)),
        unloaded=unloaded,
        pressed=pressed,
        zero_n=0.5,
        zero_deviation_n=0.01,
    )


def _judged(now):
    return compare_presses(_press(), now, depth_uncertainty_m=20e-6)


@pytest.mark.parametrize("missed_m", [-3e-5, 0.0, 3e-5])
def test_a_missed_first_contact_is_no_change_of_the_gel(missed_m):
    """A shift of the depth is told from a stiffness."""
    state = _judged(_press(missed_m=missed_m, seed=1))
    assert state.advice is Advice.KEEP
    assert abs(state.changes[0].value) < 3.0 * state.changes[0].uncertainty


@pytest.mark.parametrize("factor", [0.85, 1.15])
def test_another_modulus_is_found_and_the_gel_replaced(factor):
    """The change is within three of its uncertainties; the reason says which way it went."""
    state = _judged(_press(factor=factor, missed_m=1e-5, seed=2))
    modulus = state.changes[0]
    assert abs(modulus.value - (factor - 1.0)) < 3.0 * modulus.uncertainty
    assert state.advice is Advice.REPLACE
    assert ("harder" if factor > 1.0 else "softer") in state.reason


def _over(press, pattern, moved_px=0):
    images = {k: np.roll(getattr(press, k) + pattern, moved_px, 1) for k in ("unloaded", "pressed")}
    return replace(press, **images)


def _dim(press):
    return replace(press, unloaded=0.85 * press.unloaded, pressed=0.85 * press.pressed)


OWN, OTHER = np.random.default_rng(6).normal(0.0, 2.0, (2, 60, 80, 1))


@pytest.mark.parametrize(
    ("now", "said"),
    [
        (_over(_press(seed=3), OWN), "nothing changed"),
        (_over(_press(seed=3), OTHER), "another gel"),
        (_over(_press(seed=3), OWN, -3), "-2.7 px to the right and "),
        # The contact itself looks the same at that light.
        (_dim(_over(_press(seed=3), OWN)), "light"),
        (replace(_over(_press(seed=5), OWN), zero_n=2.0), "--check-weight"),
    ],
)
def test_what_calls_for_a_calibration_is_named(now, said):
    """A gel that was replaced, a camera that moved, less light, a cell's zero."""
    state = compare_presses(_over(_press(), OWN), now, depth_uncertainty_m=20e-6)
    assert state.advice is (Advice.KEEP if "nothing" in said else Advice.RECALIBRATE)
    assert said in state.reason


def test_a_contact_that_looks_otherwise_wears_the_gel_out():
    """Half of the dent is not seen any more."""
    press = _press(seed=4)
    worn = press.pressed.copy()
    worn[20:30, 30:50] -= 30.0
    assert _judged(replace(press, pressed=worn)).advice is Advice.REPLACE


def test_images_of_another_size_are_refused():
    """Another camera mode cannot be compared."""
    press = _press()
    with pytest.raises(RecordError, match="cannot be compared"):
        _judged(replace(press, unloaded=press.unloaded[:30], pressed=press.pressed[:30]))
