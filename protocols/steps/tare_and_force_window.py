"""Zeros of the force sensor. Raw force stays raw: a tare is kept beside it."""

from drivers.force_sensor.weighing import tare_of
from protocols.control.cycle import Cycle
from protocols.guard.breach_reaction import BreachError, Reaction
from protocols.steps.arm_moves import listen
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.run import FZ, Criterion, Tare

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
