"""What no sensor file and no recording states of a press: standard uncertainties, with defaults.

Each field that ``rig.toml`` leaves out takes a default with its source;
``docs/explanation/uncertainty.md`` lists them. A uniform distribution of half width a has the
standard uncertainty a / sqrt(3) (GUM 4.3.7).
"""

import math
from dataclasses import dataclass

from tacauchy_rig.core.config.settings import RigConfig, RobotModel

DEPTH_ERROR_M = {RobotModel.E_SERIES: 20e-6, RobotModel.CB3: 30e-6}
"""Difference of two heights within a millimetre: below the repeatability that the data sheets give
for coming back from anywhere, 30 um and 100 um. Likely, not measured."""
LAG_S = 0.05
"""Between a height and the force that belongs to it; times the press's speed it is a depth."""
REFINE_RATIO = 5.0
"""How many times slower than ``robot.search_speed`` the gel is met the second time."""
MOUNTING_TILT_RAD = math.radians(2.0)
"""How far an indenter's face may lean against the gel: what is seen by eye while mounting it."""
_UNIFORM = 1.0 / math.sqrt(3.0)
_FINE_M = ((6e-3, 0.05e-3), (30e-3, 0.1e-3), (120e-3, 0.15e-3))
"""ISO 2768-1, class f: up to this diameter [m], so much either way [m]."""
_FILLET_SHARE, _SHARP_M = 0.5, 0.05e-3
_FRICTION, _PLACE_M, _SCALE = 0.2, 0.3e-3, 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class Stated:
    """A standard uncertainty, SI, and where it is from."""

    value: float
    source: str


def stated_uncertainty(config: RigConfig, field: str) -> Stated:
    """Return what a configuration states of one field of ``[uncertainty]``, or its default."""
    given: float | None = getattr(config.uncertainty, field)
    if given is not None:
        return Stated(value=given, source=f"uncertainty.{field} of rig.toml")
    fillet_m, diameter_m = config.indenter.fillet, config.indenter.diameter
    fine_m = next(half_m for most_m, half_m in _FINE_M if diameter_m <= most_m)
    defaults = {
        "diameter": (_UNIFORM * fine_m, f"default: ISO 2768-1 f, +-{fine_m * 1e3:g} mm"),
        "fillet": (_UNIFORM * _FILLET_SHARE * fillet_m, "default: half of it either way")
        if fillet_m
        else (_UNIFORM * _SHARP_M, "default: an edge that is broken by up to 0.05 mm"),
        "friction": (_FRICTION, "default: silicone on metal or plastic, assumed"),
        "tilt": (_UNIFORM * MOUNTING_TILT_RAD, "default: 2 deg are seen by eye while mounting"),
        "offset": (_PLACE_M, "default: a tool's centre and a gel's found by eye and ruler"),
        "depth": (
            DEPTH_ERROR_M[config.robot.model],
            "default: two heights within a millimetre, likely, not measured",
        ),
        "force_scale": (_SCALE, "default: 1 % of the reading, as sheets of such cells have it"),
        "delay": (_UNIFORM * LAG_S, "default: 50 ms between a height and its force at most"),
    }
    value, source = defaults[field]
    return Stated(value=value, source=source)
