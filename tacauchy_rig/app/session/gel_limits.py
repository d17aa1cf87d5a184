"""Limits of a configuration against the gel of its sensor: what the gel would not survive."""

from __future__ import annotations

import math

from tacauchy_rig.app.replay.inputs import sensor_of
from tacauchy_rig.core.config.model import RigConfig
from tacauchy_rig.core.errors import ConfigError

DEPTH_SHARE = 0.8
"""Of the gel's height in the middle: what is left of a DIGIT's 2.5 mm over the window is 0.5 mm."""
PRESSURE_MODULI = 5.0
"""Young's moduli that the mean pressure may reach: silicones tear at a few times their modulus."""


def check_gel(config: RigConfig) -> str:
    """Refuse limits beyond what the sensor's gel bears.

    Returns:
        The gel and what the limits leave of it, in words.

    Raises:
        ConfigError: ``limits.max_depth`` goes through the gel, or ``limits.hard_force`` tears it;
            each is named.
    """
    sensor = sensor_of(config)
    height_m = sensor.pad.height_m
    stiffest_pa = max(
        (layer.material.young_pa for layer in sensor.layers), default=sensor.material.young_pa
    )
    pressure_pa = config.limits.hard_force / (math.pi * config.indenter.diameter**2 / 4.0)
    problems = []
    if config.limits.max_depth > DEPTH_SHARE * height_m:
        problems.append(
            f"limits.max_depth: {config.limits.max_depth * 1e3:g} mm is more than "
            f"{DEPTH_SHARE:.0%} of the gel of {sensor.title}, {height_m * 1e3:g} mm high; write at "
            f'most "{DEPTH_SHARE * height_m * 1e3:.3g} mm"'
        )
    if pressure_pa > PRESSURE_MODULI * stiffest_pa:
        most_n = config.limits.hard_force * PRESSURE_MODULI * stiffest_pa / pressure_pa
        problems.append(
            f"limits.hard_force: {config.limits.hard_force:g} N under an indenter of "
            f"{config.indenter.diameter * 1e3:g} mm are {pressure_pa * 1e-6:.2g} MPa, more than "
            f"{PRESSURE_MODULI:g} times the modulus of the gel of {sensor.title}, "
            f'{stiffest_pa * 1e-6:g} MPa: it tears; write at most "{most_n:.3g} N"'
        )
    if problems:
        raise ConfigError(
            "\n".join(problems), remedy="correct the limit, sensor.name or indenter.diameter"
        )
    return (
        f"{sensor.title}, {height_m * 1e3:g} mm high: max_depth leaves "
        f"{(height_m - config.limits.max_depth) * 1e3:.3g} mm of it, hard_force presses with "
        f"{pressure_pa * 1e-6:.2g} MPa on {stiffest_pa * 1e-6:g} MPa"
    )
