"""Force while the arm stands still: its statistics, and zeros of the force sensor.

Raw force stays raw: a tare is kept beside it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drivers.force_sensor.weighing import tare_of
from protocols.control.cycle import Cycle, Press
from protocols.guard.breach_reaction import BreachError, Reaction
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.run import FZ, Criterion, Tare


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceWindow:
    """Statistics of the pressing force over a window; the slope is that of least squares."""

    start_ns: int
    end_ns: int
    mean_n: float
    deviation_n: float
    slope_n_s: float


def summarise(presses: Sequence[Press]) -> ForceWindow:
    """Return the statistics of at least two samples."""
    force = np.array([press.force_n for press in presses])
    stamps = np.array([press.stamp_ns - presses[0].stamp_ns for press in presses]) * 1e-9
    centred = stamps - stamps.mean()
    spread = float(centred @ centred)
    return ForceWindow(
        start_ns=presses[0].stamp_ns,
        end_ns=presses[-1].stamp_ns,
        mean_n=float(force.mean()),
        deviation_n=float(force.std(ddof=1)),
        slope_n_s=float(centred @ force) / spread if spread > 0.0 else 0.0,
    )


def listen(cycle: Cycle, duration_s: float) -> list[Press]:
    """Stand still for ``duration_s`` [s] and return what was felt.

    The last turn begins when it is over: what came while the computer was held up is not lost.
    """
    clock = cycle.rig.clock
    end_ns = clock.now_ns() + round(duration_s * 1e9)
    presses: list[Press] = []
    is_over = False
    while not is_over:
        is_over = clock.now_ns() >= end_ns
        presses += cycle.turn().presses
    return presses


TRIES = 3
MIN_SHARE = 0.5


def take_tare(cycle: Cycle) -> Tare:
    """Average the raw wrench over ``protocol.tare_duration``, standing still.

    Raises:
        BreachError: Fewer than half of the expected samples came.
    """
    duration_s = cycle.config.protocol.tare_duration
    samples = [press.raw for press in listen(cycle, duration_s)]
    expected = duration_s * cycle.config.force_sensor.rate
    if len(samples) < max(2.0, MIN_SHARE * expected):
        raise BreachError(
            f"force sensor: {len(samples)} samples in {duration_s:g} s of tare, "
            f"{expected:.0f} were expected",
            limit="protocol.tare_duration",
            reaction=Reaction.HOLD,
            remedy="check force_sensor.rate against what the box sends",
        )
    return tare_of(samples)


def take_quiet_tare(cycle: Cycle) -> Tare:
    """Take tares until one passes the gate, at most ``TRIES``; return the last one."""
    tare = take_tare(cycle)
    for _ in range(TRIES - 1):
        if all(criterion.passed for criterion in judge_tare(tare, cycle.config)):
            break
        tare = take_tare(cycle)
    return tare


def judge_tare(tare: Tare, config: RigConfig) -> tuple[Criterion, ...]:
    """Compare mean and deviation of an unloaded interval with their gates."""
    protocol = config.protocol
    return (
        Criterion.at_most(
            "tare_deviation",
            max(tare.deviation[:3]),
            protocol.tare_deviation,
            unit="N",
            remedy="let the table come to rest; look for fans and loose cables",
        ),
        Criterion.at_most(
            "tare_mean",
            max(map(abs, tare.mean[:3])),
            protocol.tare_mean,
            unit="N",
            remedy="see what hangs on the sensor; zero the box",
        ),
    )


def force_drift(before: Tare, after: Tare, *, config: RigConfig) -> float:
    """Return the unloaded pressing force after minus before [N]."""
    return config.force_sensor.compression_sign * (after.mean[FZ] - before.mean[FZ])
