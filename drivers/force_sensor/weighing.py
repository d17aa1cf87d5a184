"""Weigh what an operator hangs on the force sensor; nothing else is connected, nothing moves."""

import math
from collections.abc import Callable, Sequence
from enum import StrEnum

import numpy as np

from drivers.interfaces import Clock, ForceTorqueSensor
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.errors import DeviceError
from tacauchy_rig.core.registry import Kind, load
from tacauchy_rig.core.run import ForceSample, Tare, vector6

SETTLE_S = 1.0
"""After the operator's word: the hand is gone, and a weight on a string has stopped bouncing."""
WEIGH_S = 2.0
"""Several swings of a weight on a string of 10 to 20 cm."""
POLL_S = 0.05
"""How often the stream is emptied."""
MIN_SHARE = 0.5
"""Of the samples that the configured rate promises."""


class Load(StrEnum):
    """What the cell carries while it is read; the value asks for it."""

    NONE = "nothing hangs on the tool, and it touches nothing"
    WEIGHT = "the weight hangs still from the tool and touches nothing"
    NONE_AGAIN = "the weight is taken off again"


def weigh_connected(
    sensor: ForceTorqueSensor, clock: Clock, config: RigConfig, *, ask: Callable[[Load], None]
) -> tuple[Tare, Tare, Tare]:
    """Return the raw wrench without, with, and again without the load.

    Args:
        ask: Returns once the cell carries what is asked for.

    Raises:
        DeviceError: It is silent, too slow, saturated, or sends a value that is not a number.
    """
    found = []
    for wanted in Load:
        ask(wanted)
        _listen(sensor, clock, SETTLE_S)
        found.append(_summary(_listen(sensor, clock, WEIGH_S), config))
    before, loaded, after = found
    return before, loaded, after


def weigh(config: RigConfig, *, ask: Callable[[Load], None]) -> tuple[Tare, Tare, Tare]:
    """Connect the configured sensor alone, weigh, and let go of it; see ``weigh_connected``."""
    sensor: ForceTorqueSensor = load(Kind.FORCE_SENSOR, config.force_sensor.driver)(config, None)
    try:
        sensor.connect()
        return weigh_connected(sensor, Clock(), config, ask=ask)
    finally:
        sensor.close()


def _listen(sensor: ForceTorqueSensor, clock: Clock, duration_s: float) -> list[ForceSample]:
    sensor.drain()
    samples: list[ForceSample] = []
    end_ns = clock.now_ns() + round(duration_s * 1e9)
    while clock.now_ns() < end_ns:
        clock.sleep(POLL_S)
        samples += sensor.drain()
    return samples


def _summary(samples: list[ForceSample], config: RigConfig) -> Tare:
    section = config.force_sensor
    expected = WEIGH_S * section.rate
    if len(samples) < max(2.0, MIN_SHARE * expected):
        raise DeviceError(
            f"force sensor: {len(samples)} samples in {WEIGH_S:g} s, {expected:.0f} were expected",
            remedy="check the box's power and cable, and force_sensor.rate",
        )
    if not all(math.isfinite(value) for s in samples for value in s.wrench):
        raise DeviceError(
            "force sensor: a sample holds a value that is not a number",
            remedy="check the box's cable and its decoupling matrix",
        )
    largest_n = max(abs(value) for s in samples for value in s.wrench[:3])
    if largest_n >= section.capacity:
        raise DeviceError(
            f"force sensor: {largest_n:.4g} N is beyond its capacity {section.capacity:g} N",
            remedy="hang less; check force_sensor.capacity against the calibration sheet",
        )
    return tare_of(samples)


def tare_of(samples: Sequence[ForceSample]) -> Tare:
    """Return mean and deviation of at least two samples."""
    wrenches = np.array([sample.wrench for sample in samples])
    return Tare(
        start_ns=samples[0].stamp_ns,
        end_ns=samples[-1].stamp_ns,
        mean=vector6(wrenches.mean(axis=0).tolist()),
        deviation=vector6(wrenches.std(axis=0, ddof=1).tolist()),
        sample_count=len(samples),
    )
