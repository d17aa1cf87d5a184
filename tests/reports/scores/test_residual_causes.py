"""A residual is split into what was put into it, and nothing of it is lost or made up."""

import numpy as np
import pytest

from reports.evidence.evidence_types import TrialImages
from reports.scores.residual_causes import Cause, Mode, split_residual
from tacauchy_rig.core.arrays import FloatArray, ImageArray
from tacauchy_rig.core.simulated import ResidualSplit
from tests.reports.conftest import background, contact_change

FORCES_N = {1: 1.5, 2: 3.0, 3: 4.5}
SIZE = 0.1


def _image(change: FloatArray) -> ImageArray:
    noise = np.random.default_rng(3).normal(0.0, 0.4, change.shape)
    return np.clip(np.rint(background() + change + noise), 0, 255).astype(np.uint8)


def _gain(cause: Cause, size: float = SIZE) -> Mode:
    changes = {i: size * contact_change(force_n) for i, force_n in FORCES_N.items()}
    return Mode(name=cause.value, cause=cause, size=size, unit="1", changes=changes)


def _wider() -> Mode:
    changes = {
        i: contact_change(force_n, skirt_px=11.0) - contact_change(force_n)
        for i, force_n in FORCES_N.items()
    }
    return Mode(name="skirt", cause=Cause.MATERIAL, size=1.0, unit="1", changes=changes)


def _split(
    modes: list[Mode],
    *,
    gain: float = 1.0,
    center_px: tuple[float, float] = (160.0, 120.0),
    skirt_px: float = 9.0,
) -> ResidualSplit:
    """Split what is left of presses that are other than simulated."""
    reference = _image(np.zeros((240, 320, 3)))
    seen, simulated = {}, {}
    for index, force_n in FORCES_N.items():
        real = gain * contact_change(force_n, center_px=center_px, skirt_px=skirt_px)
        seen[index] = TrialImages(real=_image(real), reference=reference)
        simulated[index] = _image(contact_change(force_n))
    found = split_residual(seen, simulated, modes, pose_px=(4.0, 4.0))
    assert found is not None
    return found


def _found(split: ResidualSplit, name: str) -> float:
    return next(each.value for each in split.found if each.name == name)


def test_what_was_put_in_is_found_and_comes_first() -> None:
    """Lamps a fifth brighter, a contact beside its place, a skirt that is wider."""
    modes = [_gain(Cause.LIGHT), _wider()]
    bright = _split(modes, gain=1.2)
    assert next(iter(bright.shares)) == Cause.LIGHT
    assert _found(bright, "light") == pytest.approx(0.2, abs=0.01)
    beside = _split(modes, center_px=(164.0, 118.0))
    assert next(iter(beside.shares)) == Cause.POSE
    assert _found(beside, "place along x") == pytest.approx(4.0, abs=0.05)
    assert _found(beside, "place along y") == pytest.approx(-2.0, abs=0.05)
    assert next(iter(_split(modes, skirt_px=11.0).shares)) == Cause.MATERIAL


def test_shares_add_up_in_each_trial_and_of_all() -> None:
    """To one, whatever is in them; the residual is that of the contact score."""
    split = _split([_gain(Cause.LIGHT), _wider()], gain=0.9, center_px=(161.0, 120.5))
    for shares in (split.shares, *(trial.shares for trial in split.trials)):
        assert set(shares) == set(Cause)
        assert sum(shares.values()) == pytest.approx(1.0)
    assert [trial.trial for trial in split.trials] == [1, 2, 3]
    assert 0.05 < split.trials[2].residual < 0.5


def test_what_images_cannot_tell_apart_goes_to_what_is_known_less_well() -> None:
    """In proportion to the variances: a hundred to one."""
    split = _split([_gain(Cause.MATERIAL, 0.1), _gain(Cause.FORCE, 0.01)], gain=1.15)
    ratio = _found(split, "material") / _found(split, "force error")
    assert ratio == pytest.approx(100.0, rel=0.02)
    assert split.shares[Cause.MATERIAL] > 0.8


def test_noise_is_noise() -> None:
    """What two halves of a dwell differ by is none of the causes'."""
    rng = np.random.default_rng(5)

    def noisy(change: FloatArray, sigma: float) -> ImageArray:
        return np.clip(
            np.rint(background() + change + rng.normal(0.0, sigma, change.shape)), 0, 255
        ).astype(np.uint8)

    change, none = contact_change(4.5), np.zeros((240, 320, 3))
    images = TrialImages(
        real=noisy(change, 2.0),
        reference=noisy(none, 2.0),
        first_half=noisy(change, 2.0 * np.sqrt(2.0)),
        second_half=noisy(change, 2.0 * np.sqrt(2.0)),
    )
    simulated = np.clip(np.rint(images.reference + change), 0, 255).astype(np.uint8)
    split = split_residual({1: images}, {1: simulated}, [_gain(Cause.LIGHT)], pose_px=(4.0, 4.0))
    assert split.shares[Cause.NOISE] > 0.9


def test_without_a_contact_there_is_nothing_to_split() -> None:
    """Frames of an unloaded gel have no residual of a contact."""
    frame = _image(np.zeros((240, 320, 3)))
    images = TrialImages(real=frame, reference=frame)
    assert split_residual({1: images}, {1: frame}, [], pose_px=(4.0, 4.0)) is None
