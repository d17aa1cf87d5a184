"""What the residual inside the contact is made of, by what re-simulated causes would change of it.

The residual R = real - simulated of all trials of a run is taken for a sum of what each cause does
to the images and a rest. Unknowns are found together, by least squares with their standard
uncertainties as priors: where images cannot tell two causes apart, such as a stiffer gel from a
cell that reads too much, the less certain one takes it. With C_k what cause k comes to, its share
is its Shapley value of |R|^2 - |R - sum C|^2 over all subsets of causes, which for sums is

    <C_k, R + rest>,    rest = R - sum_k C_k,

so that shares and |rest|^2 add up to |R|^2. A share is below zero where a cause takes back what
another does too much.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial

import numpy as np

from reports.evidence.evidence_types import TrialImages
from reports.scores import contact_scores
from tacauchy_rig.core.arrays import BoolArray, FloatArray, ImageArray
from tacauchy_rig.core.simulated import FoundCause, ResidualSplit, TrialSplit

STEPS = 4  # of Gauss and Newton: a contact is moved to where the step before found it
ALIKE = 300.0
"""Values of an image that are wrong together where a model is wrong: three channels of 10 x 10
pixels, about the width of a rim. So much less do they weigh against what is known beforehand."""
SMOOTHING_PX = 1.5
"""Unknowns are found in images without what neither a mesh nor a camera tells of a contact: with it
half as much of a planted tilt or modulus is found. Shares are of the images as they are."""

_smoothed = partial(contact_scores.smooth_change, sigma_px=SMOOTHING_PX)
_AROUND_PX = 8  # five standard deviations of the smoothing
_LEAST_SQUARE = 1e-9  # [grey level^2] of a residual: images of the same press weigh no more
_PLACES = ("place along x", "place along y")


class Cause(StrEnum):
    """What an image may be off by."""

    POSE = "pose"
    TILT = "tilt"
    LIGHT = "light"
    FORCE = "force error"
    MATERIAL = "material"
    OPTICS = "optics"
    NOISE = "noise"
    REST = "rest"


UNMENDABLE = (Cause.NOISE, Cause.REST)  # of which nobody knows what to do about them


@dataclass(frozen=True, slots=True)
class Mode:
    """What one unknown does to the images."""

    name: str
    cause: Cause
    size: float  # its standard uncertainty, in ``unit``
    unit: str
    # By trial, what so much of it changes [grey level], shape [height, width, 3].
    changes: Mapping[int, FloatArray]


@dataclass(frozen=True, slots=True)
class _Trial:
    """Changes against the no-contact frame, and where they count."""

    index: int
    real: FloatArray
    simulated: FloatArray
    region: BoolArray
    # The rows and columns of the region, and some more for what is smoothed or moved.
    around: tuple[slice, slice]
    noise: float  # mean square of the camera's noise in their difference [grey level^2]

    @property
    def inside(self) -> BoolArray:
        """The region, of what is around it."""
        return self.region[self.around]

    def moved(self, place: tuple[float, float]) -> FloatArray:
        """Return the simulated change as it would lie there [px], around the contact."""
        return contact_scores.shift_change(self.simulated, *place)[self.around]


def split_residual(
    seen: Mapping[int, TrialImages],
    simulated: Mapping[int, ImageArray],
    modes: Iterable[Mode],
    *,
    pose_px: tuple[float, float],
) -> ResidualSplit | None:
    """Split the residuals of a run's trials; None where no image shows a contact.

    Args:
        seen: What the camera saw, by trial.
        simulated: What the replay rendered.
        modes: What is uncertain besides the contact's place in the image, one after the other:
            of each only what lies around the contacts is kept. Those of one name are one.
        pose_px: Standard uncertainty of that along x and y [px].
    """
    trials = [
        trial
        for index in sorted(seen.keys() & simulated.keys())
        if (trial := _trial(index, seen[index], simulated[index])) is not None
    ]
    if not trials:
        return None
    place = _place(trials)
    plain, softened = dict[str, Mode](), dict[str, Mode]()
    for mode in modes:
        around = {
            t.index: contact_scores.shift_change(mode.changes[t.index], *place)[t.around]
            for t in trials
            if t.index in mode.changes
        }
        for kept, seen_as in ((plain, np.asarray), (softened, _smoothed)):
            own = _inside(replace(mode, changes=around), trials, seen_as)
            known = kept.get(own.name, own)
            kept[own.name] = replace(known, changes={**known.changes, **own.changes})
    moved, smooth = list(plain.values()), list(softened.values())
    for step in range(STEPS):
        found = _solve(trials, place, [*_posed(trials, place, pose_px, _smoothed), *smooth])
        if step < STEPS - 1:
            place = (place[0] + found[0] * pose_px[0], place[1] + found[1] * pose_px[1])
    return _shared(trials, place, [*_posed(trials, place, pose_px, np.asarray), *moved], found)


def _trial(index: int, images: TrialImages, simulated: ImageArray) -> _Trial | None:
    real, made = (
        contact_scores.image_change(each, images.reference) for each in (images.real, simulated)
    )
    seen = contact_scores.touched(images)
    if seen is None:
        return None
    around = contact_scores.rectangle_around(seen.region, margin_px=_AROUND_PX)
    return _Trial(index, real, made, seen.region, around, _noise(images))


def _noise(images: TrialImages) -> float:
    """Return the mean square of the noise of a dwell's median and of its no-contact frame's.

    Halves of a dwell are each twice as noisy as the whole, and differ by both; the no-contact frame
    is taken to be as noisy as the dwell's.
    """
    if images.first_half is None or images.second_half is None:
        return 0.0
    apart = contact_scores.image_change(images.first_half, images.second_half)
    return 2.0 * 0.25 * float(np.mean(np.square(apart)))


def _place(trials: Sequence[_Trial]) -> tuple[float, float]:
    """Return how far the contacts lie beside where they are simulated [px], of all trials."""
    found = [contact_scores.register_changes(t.real, t.simulated, t.region) for t in trials]
    known = [shift for shift in found if shift is not None]
    if not known:
        return 0.0, 0.0
    x, y = np.median(known, axis=0).tolist()
    return x, y


def _inside(mode: Mode, trials: Sequence[_Trial], seen: Callable[[FloatArray], FloatArray]) -> Mode:
    """Return a mode of what it changes inside the contacts, of shape [value_count]."""
    changes = {
        t.index: seen(mode.changes[t.index])[t.inside].ravel()
        for t in trials
        if t.index in mode.changes
    }
    return replace(mode, changes=changes)


def _posed(
    trials: Sequence[_Trial],
    place: tuple[float, float],
    pose_px: tuple[float, float],
    seen: Callable[[FloatArray], FloatArray],
) -> list[Mode]:
    """Return the modes of the contacts' place, inside them."""
    moved = {t.index: seen(t.moved(place)) for t in trials}
    modes = [
        Mode(
            name=name,
            cause=Cause.POSE,
            size=size,
            unit="px",
            changes={i: -size * np.gradient(image, axis=axis) for i, image in moved.items()},
        )
        for name, axis, size in zip(_PLACES, (1, 0), pose_px, strict=True)
    ]
    return [_inside(mode, trials, np.asarray) for mode in modes]


def _solve(
    trials: Sequence[_Trial], place: tuple[float, float], modes: Sequence[Mode]
) -> FloatArray:
    """Return the unknowns over their standard uncertainties, shape [mode_count]."""
    normal, right, square, count = np.zeros((len(modes),) * 2), np.zeros(len(modes)), 0.0, 0
    for trial in trials:
        off = _smoothed(trial.real[trial.around] - trial.moved(place))[trial.inside].ravel()
        columns = _columns(trial, modes)
        normal += columns @ columns.T
        right += columns @ off
        square, count = square + float(off @ off), count + len(off)
    left = square
    # What is left says how well a replay can explain images, and so what they weigh.
    for _ in range(STEPS):
        prior = ALIKE * max(left / count, _LEAST_SQUARE) * np.eye(len(modes))
        found = np.linalg.solve(normal + prior, right)
        left = float(square - 2.0 * found @ right + found @ normal @ found)
    return np.asarray(found)


def _columns(trial: _Trial, modes: Sequence[Mode]) -> FloatArray:
    """Return what the modes change inside a contact, shape [mode_count, value_count]."""
    none = np.zeros(3 * np.count_nonzero(trial.inside))
    return np.stack([m.changes.get(trial.index, none) for m in modes])


def _shared(
    trials: Sequence[_Trial], place: tuple[float, float], modes: Sequence[Mode], found: FloatArray
) -> ResidualSplit:
    squares = {t.index: _squares(t, place, modes, found) for t in trials}
    total = {cause: sum(each[cause] for each in squares.values()) for cause in Cause}
    ranked = sorted(total, key=lambda cause: -total[cause])
    beside = dict(zip(_PLACES, place, strict=True))
    return ResidualSplit(
        trials=tuple(
            TrialSplit(
                trial=t.index,
                residual=contact_scores.relative_residual(t.real, t.simulated, t.region),
                shares=_of_all(squares[t.index], ranked),
            )
            for t in trials
        ),
        shares=_of_all(total, ranked),
        found=tuple(
            FoundCause(
                name=m.name,
                cause=m.cause.value,
                value=float(value * m.size) + beside.get(m.name, 0.0),
                unit=m.unit,
            )
            for m, value in zip(modes, found, strict=True)
        ),
    )


def _squares(
    trial: _Trial, place: tuple[float, float], modes: Sequence[Mode], found: FloatArray
) -> dict[Cause, float]:
    """Return the part of each cause in the square of a trial's residual [grey level^2]."""
    off = (trial.real - trial.simulated)[trial.region].ravel()
    moved = trial.moved(place) - trial.simulated[trial.around]
    parts = {cause: np.zeros(len(off)) for cause in Cause}
    parts[Cause.POSE] += moved[trial.inside].ravel()
    for mode, column, value in zip(modes, _columns(trial, modes), found, strict=True):
        parts[mode.cause] += value * column
    rest = off - sum(parts.values())
    squares = {cause: float(part @ (off + rest)) for cause, part in parts.items()}
    squares[Cause.NOISE] = min(float(rest @ rest), trial.noise * len(off))
    squares[Cause.REST] = float(rest @ rest) - squares[Cause.NOISE]
    return squares


def _of_all(squares: Mapping[Cause, float], order: Sequence[Cause]) -> dict[str, float]:
    whole = sum(squares.values())
    return {cause.value: squares[cause] / whole if whole else 0.0 for cause in order}
