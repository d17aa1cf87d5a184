"""Ours against every other simulator, score by score and press by press."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from reports.comparison.judged_scores import ALL, Score
from reports.comparison.judging import JudgedPress, JudgedSimulator, Judgement
from reports.scores.metrics import MeanInterval, t_interval


@dataclass(frozen=True, slots=True, kw_only=True)
class Contest:
    """Ours against one other in one score.

    Attributes:
        ours: Mean over the presses that both have, in the score's unit; ``theirs`` likewise.
        difference: Theirs minus ours, press by press, turned so that above zero ours is better;
            None where the score is only of the means.
    """

    other: str
    score: Score
    ours: float
    theirs: float
    difference: MeanInterval

    @property
    def is_lost(self) -> bool:
        """Ours is worse in the mean."""
        return self.difference.mean is not None and self.difference.mean < 0.0

    @property
    def is_clear(self) -> bool:
        """The 95 % interval of the difference does not hold zero."""
        low, high = self.difference.low, self.difference.high
        return low is not None and high is not None and (low > 0.0 or high < 0.0)


def contests(judgement: Judgement) -> tuple[Contest, ...]:
    """Set ours against every other in every score that both have."""
    ours = next((s for s in judgement.simulators if s.is_ours), None)
    if ours is None:
        return ()
    others = [s for s in judgement.simulators if s is not ours]
    return tuple(contest for other in others for contest in _against(ours, other))


def _against(ours: JudgedSimulator, other: JudgedSimulator) -> Iterator[Contest]:
    mine, theirs = _by_index(ours), _by_index(other)
    shared = sorted(set(mine) & set(theirs))
    for score in ALL:
        if score.larger_is_better is None:
            continue
        pairs = [(mine[i].value(score.key), theirs[i].value(score.key)) for i in shared]
        both = [(a, b) for a, b in pairs if a is not None and b is not None]
        if not both:
            continue
        sign = -1.0 if score.larger_is_better else 1.0
        first, second = (t_interval(values).mean for values in zip(*both, strict=True))
        if first is not None and second is not None:
            yield Contest(
                other=other.simulator.title,
                score=score,
                ours=score.factor * first,
                theirs=score.factor * second,
                difference=t_interval([sign * score.factor * (b - a) for a, b in both]),
            )


def _by_index(simulator: JudgedSimulator) -> Mapping[int, JudgedPress]:
    return {press.index: press for press in simulator.presses}
