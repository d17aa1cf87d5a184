"""A sensor's file with the gel that was fitted, all else as it was."""

from __future__ import annotations

import re
from pathlib import Path

from sim.sensor.sensor import parse_sensor
from tacauchy_rig.app.calibration.material.fit import Interval
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.registry import Kind, load, unknown


def sensor_text(name: str) -> str:
    """Return the text of a sensor's file, built in or by its path.

    Raises:
        ConfigError: It cannot be read.
    """
    path: Path = Path(name) if unknown(Kind.SENSOR, name) else load(Kind.SENSOR, name)
    try:
        return path.read_text("utf-8")
    except OSError as error:
        raise ConfigError(f"sensor {name}: {error.strerror}", remedy="give its path") from error


def with_gel(text: str, *, young: Interval, poisson: Interval, source: str) -> str:
    """Return the file's text with what was told of its gel; what was not stays as it was.

    Raises:
        ConfigError: It has no line ``young = `` in ``[material]``.
    """
    for key, told, factor, unit in (
        ("young", young, 1e-6, " MPa"),
        ("poisson", poisson, 1.0, ""),
    ):
        if told.uncertainty is None:
            continue
        line = (
            f'{key} = {{ value = "{told.best * factor:.5g}{unit}", uncertainty = '
            f'"{told.uncertainty * factor:.2g}{unit}", source = "{source}" }}'
        )
        # A source may hold a backslash, which a replacement would read as its own.
        escaped = line.replace("\\", r"\\")
        text, count = re.subn(rf"(?m)^{key} = \{{.*\}}[ \t]*$", escaped, text)
        if count != 1:
            raise ConfigError(
                f"the sensor's file has {count} lines `{key} = {{ ... }}`",
                remedy="write it as one line in [material]",
            )
    parse_sensor(text, origin="the calibrated sensor's file")
    return text
