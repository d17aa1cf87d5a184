"""The simulated contact pressure, along two lines through the indenter's tip and at places."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import LinearNDInterpolator

from tacauchy_rig.core.arrays import FloatArray

_POINTS = 401
_REACH = 1.3
"""Of the contact's radius, to either side."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PressureProfile:
    """Contact pressure [Pa] along x and y, each of shape [n].

    Attributes:
        along_m: Distance from the tip [m].
    """

    along_m: FloatArray
    on_x_pa: FloatArray
    on_y_pa: FloatArray


def pressure_profile(fields: Mapping[str, NDArray[Any]]) -> PressureProfile | None:
    """Return the profiles of a replayed trial's arrays; None where they have no pressure."""
    if not {"node_m", "contact_pressure_pa", "indenter_tip_m"} <= fields.keys():
        return None
    places = fields["node_m"][:, :2] - fields["indenter_tip_m"][:2]
    pressure = fields["contact_pressure_pa"]
    touched = places[pressure > 0.0]
    if len(touched) == 0:
        return None
    reach_m = _REACH * float(np.linalg.norm(touched, axis=1).max())
    along = np.linspace(-reach_m, reach_m, _POINTS)
    at = LinearNDInterpolator(places, pressure, fill_value=0.0)
    none = np.zeros_like(along)
    return PressureProfile(along_m=along, on_x_pa=at(along, none), on_y_pa=at(none, along))


def pressure_at(
    fields: Mapping[str, NDArray[Any]], x_m: FloatArray, y_m: FloatArray
) -> FloatArray | None:
    """Return a replayed trial's contact pressure at places of the pad [Pa]; None without one."""
    return _at(fields, "contact_pressure_pa", x_m, y_m)


def shear_at(
    fields: Mapping[str, NDArray[Any]], x_m: FloatArray, y_m: FloatArray
) -> FloatArray | None:
    """Return the shear on the gel along x and y there [Pa], a last axis of 2; None likewise."""
    shear = _at(fields, "contact_shear_pa", x_m, y_m)
    return None if shear is None else shear[..., :2]


def _at(
    fields: Mapping[str, NDArray[Any]], name: str, x_m: FloatArray, y_m: FloatArray
) -> FloatArray | None:
    if not {"node_m", name} <= fields.keys():
        return None
    at = LinearNDInterpolator(fields["node_m"][:, :2], fields[name], fill_value=0.0)
    return np.asarray(at(x_m, y_m), dtype=np.float64)
