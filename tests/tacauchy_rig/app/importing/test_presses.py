"""Presses are found in forces whose zero drifts, and clocks in signals of the same presses."""

from __future__ import annotations

import numpy as np
import pytest

from tacauchy_rig.app.importing.presses import Frame, PressFinding, S, Samples, cut, find_presses
from tacauchy_rig.app.importing.video import Signal, offset_to_force
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import FZ

HZ = 100.0
SEEDS = (11, 12, 13)


def pressed(random: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times [s], forces [N] without noise, and the force that each press is held at [N]."""
    held = random.permutation(np.linspace(1.0, 3.0, count))
    knots, values, now = [0.0], [0.0], 2.0
    for force in held:
        rise, hold = random.uniform(0.3, 1.0), random.uniform(1.0, 2.0)
        knots += [now, now + rise, now + rise + hold, now + 2.0 * rise + hold]
        values += [0.0, force, force, 0.0]
        now += 2.0 * rise + hold + random.uniform(2.0, 3.5)
    time_s = np.arange(0.0, now, 1.0 / HZ)
    return time_s, np.interp(time_s, knots, values), held


def samples(time_s: np.ndarray, force_n: np.ndarray) -> Samples:
    """Return forces along the axis as samples."""
    value = np.zeros((len(time_s), 6))
    value[:, FZ] = force_n
    return Samples(stamp_ns=np.rint((time_s + 1.0) * S).astype(np.int64), value=value)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_zero_that_drifts_is_followed(seed: int, sign: float) -> None:
    """Each press has its own force, though the zero goes further than the weakest press."""
    random = np.random.default_rng(seed)
    time_s, force_n, held = pressed(random, 12)
    drift = 1.5 * random.choice([-1.0, 1.0]) * (time_s / time_s[-1]) ** 1.5
    noise = random.normal(0.0, 0.01, len(time_s))
    force = samples(time_s, sign * force_n + drift + noise)
    found = find_presses(force, PressFinding())
    frames = [Frame(stamp_ns=t, name="", read=bytes) for t in force.stamp_ns[::10].tolist()]
    presses = cut(found, force, frames)
    told = [press.held for press in presses]
    forces = [sign * float(each[:, FZ].mean()) for each in told if each is not None]
    assert forces == pytest.approx(held.tolist(), abs=0.02)


def test_two_presses_without_a_rest_are_refused() -> None:
    """The force falls to a fifth and rises again, and never to rest."""
    time_s = np.arange(0.0, 9.0, 1.0 / HZ)
    knots = {0.0: 0.0, 2.0: 0.0, 3.0: 2.0, 4.0: 2.0, 4.3: 0.6, 4.6: 2.5, 6.0: 2.5, 6.5: 0.0}
    force_n = np.interp(time_s, list(knots), list(knots.values()))
    with pytest.raises(RecordError, match="several presses without a rest"):
        find_presses(samples(time_s, force_n), PressFinding())


def seen_of(
    random: np.random.Generator, time_s: np.ndarray, force_n: np.ndarray, shown_s: np.ndarray
) -> np.ndarray:
    """Return how far images change that show the gel at times [s]."""
    change = 5.0 * np.sqrt(np.interp(shown_s, time_s, force_n))
    return np.asarray(change + random.normal(0.0, 0.1, len(shown_s)))


@pytest.mark.parametrize("seed", SEEDS)
def test_frames_with_gaps_and_times_of_their_own_are_aligned(seed: int) -> None:
    """An uneven rate and a gap of a second: the offset is right to a frame."""
    random = np.random.default_rng(seed)
    time_s, force_n, _ = pressed(random, 5)
    force = samples(time_s, force_n + random.normal(0.0, 0.01, len(time_s)))
    shown_s = np.cumsum(random.uniform(0.03, 0.05, int(time_s[-1] / 0.04)))
    shown_s = shown_s[(shown_s < 0.4 * time_s[-1]) | (shown_s > 0.4 * time_s[-1] + 1.0)]
    own = Signal(time_s=shown_s - 0.37, value=seen_of(random, time_s, force_n, shown_s))
    offset = offset_to_force(force, own, find_presses(force, PressFinding()))
    assert offset.offset_s == pytest.approx(1.37, abs=0.04)
    assert 0.6 < offset.correlation <= 1.0


@pytest.mark.parametrize("seed", SEEDS)
def test_dropped_frames_are_refused_with_their_mean_rate(seed: int) -> None:
    """Every seventh frame is missing, and the file's times say nothing of it."""
    random = np.random.default_rng(seed)
    time_s, force_n, _ = pressed(random, 5)
    force = samples(time_s, force_n + random.normal(0.0, 0.01, len(time_s)))
    shown_s = np.arange(0.0, time_s[-1], 0.04)
    shown_s = shown_s[np.arange(len(shown_s)) % 7 != 3]
    seen = seen_of(random, time_s, force_n, shown_s)
    found = find_presses(force, PressFinding())
    with pytest.raises(RecordError, match=r"advances by|fit best") as refused:
        offset_to_force(force, Signal(time_s=0.04 * np.arange(len(shown_s)), value=seen), found)
    rate_s = 0.04 * 7.0 / 6.0
    offset = offset_to_force(
        force, Signal(time_s=rate_s * np.arange(len(shown_s)), value=seen), found
    )
    assert offset.offset_s == pytest.approx(1.0, abs=0.04)
    assert refused.value.remedy
