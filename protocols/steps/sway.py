"""Sway in the gel after a dwell: a motion whose trace in force and image tells how late they are.

Two sines at once: a delay shifts both by the same time, the gel's relaxation by the same part of
their period, so that what is told apart is no creep. The arm only ever goes up from where the force
was held, so that neither force nor depth passes what the press had reached.
"""

from __future__ import annotations

import math

from protocols.control.cycle import Cycle
from protocols.steps.motion import downward
from protocols.steps.press import PressDrive

FREQUENCIES_HZ = (1.1, 2.9)
"""No multiples of one another; the faster one has 8 frames a period at 25 fps."""
SPEED_SHARE = 0.45
"""Of ``robot.press_speed``, each; what is left leads the arm back to the path."""
RETURN_PER_S = 2.0
"""How quickly the arm is led back to its path [1/s]."""


def sway(cycle: Cycle, drive: PressDrive) -> None:
    """Sway for ``protocol.sway`` from where the arm stands.

    Raises:
        BreachError: A limit was passed.
    """
    config = cycle.config
    amplitudes_m = [
        SPEED_SHARE * config.robot.press_speed / (2.0 * math.pi * each) for each in FREQUENCIES_HZ
    ]
    reading = drive.watch()
    held_m, start_ns = drive.depth(reading), reading.now_ns
    time_s = 0.0
    while time_s < config.protocol.sway:
        depth_m, speed_m_s = held_m, 0.0
        for frequency_hz, amplitude_m in zip(FREQUENCIES_HZ, amplitudes_m, strict=True):
            rate = 2.0 * math.pi * frequency_hz
            depth_m -= amplitude_m * (1.0 - math.cos(rate * time_s))
            speed_m_s -= amplitude_m * rate * math.sin(rate * time_s)
        led_m_s = speed_m_s + RETURN_PER_S * (depth_m - drive.depth(reading))
        cap_m_s = config.robot.press_speed
        cycle.set_velocity(downward(min(cap_m_s, max(-cap_m_s, led_m_s))))
        reading = drive.watch()
        time_s = (reading.now_ns - start_ns) * 1e-9
