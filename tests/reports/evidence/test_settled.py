"""Pictures that go on changing while the pose is held, beside noise and creep."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from reports.comparison.criteria import MAX_SETTLED_CHANGE
from reports.evidence.attempt import settled_change
from tacauchy_rig.core.arrays import ImageArray

SHAPE = (60, 80, 3)
FRAMES = 30
"""1.2 s at 25 fps."""
CONTACT = np.zeros(SHAPE)
CONTACT[20:40, 30:50] = 25.0
RNG_SEED = 5


def dwell(shares: Sequence[float], *, noise: float = 1.5) -> list[ImageArray]:
    """Return frames that show each a share of the contact, with noise of so many grey levels."""
    rng = np.random.default_rng(RNG_SEED)
    return [
        np.clip(np.rint(110.0 + share * CONTACT + rng.normal(0.0, noise, SHAPE)), 0, 255).astype(
            np.uint8
        )
        for share in shares
    ]


REFERENCE = np.full(SHAPE, 110, dtype=np.uint8)


@pytest.mark.parametrize("noise", [0.0, 1.5, 4.0])
def test_noise_alone_is_no_change(noise: float) -> None:
    """A still contact, however noisy the camera."""
    assert settled_change(dwell([1.0] * FRAMES, noise=noise), REFERENCE) < 0.02


def test_a_camera_that_repeats_its_noise_is_not_accused() -> None:
    """As the emulated one does on a busy computer: three pictures for thirty frames."""
    one, two, three = dwell([1.0] * 3)
    assert settled_change([one] * 11 + [two] * 9 + [three] * 10, REFERENCE) < 0.02


def test_a_creeping_gel_is_not_accused() -> None:
    """Three percent more contact at the end than at the beginning, step by step."""
    found = settled_change(dwell(np.linspace(0.97, 1.0, FRAMES).tolist()), REFERENCE)
    assert 0.015 < found < MAX_SETTLED_CHANGE


@pytest.mark.parametrize("late", [6, 12, 23, 27])
def test_an_older_pose_is_found(late: int) -> None:
    """So many frames of a pose with three quarters of the contact: 23 frames are 0.93 s."""
    found = settled_change(dwell([0.75] * late + [1.0] * (FRAMES - late)), REFERENCE)
    expected = 0.25 * min(late, FRAMES - late, 10) / 10.0 / (1.0 - 0.25 * late / FRAMES)
    assert found == pytest.approx(expected, rel=0.1)
    assert found > MAX_SETTLED_CHANGE


def test_too_few_frames_tell_nothing() -> None:
    """Two frames have no thirds."""
    assert settled_change(dwell([1.0, 0.5]), REFERENCE) is None
    assert settled_change(dwell([1.0, 1.0, 0.5], noise=0.0), REFERENCE) > 0.4
