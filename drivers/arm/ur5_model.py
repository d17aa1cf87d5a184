"""The two controller generations, and what differs between them for a client."""

from __future__ import annotations

from enum import StrEnum


class UrModel(StrEnum):
    """Controller generation of a UR5."""

    CB3 = "cb3"
    E_SERIES = "e-series"

    @property
    def rate_hz(self) -> float:
        """RTDE cycle rate [Hz]."""
        return 125.0 if self is UrModel.CB3 else 500.0

    @property
    def stale_limit_s(self) -> float:
        """Age of a controller time stamp at which the data count as lost [s]."""
        return 0.100 if self is UrModel.CB3 else 0.050

    @property
    def major_version(self) -> int:
        """Major version of the controller software that drives this generation."""
        return 3 if self is UrModel.CB3 else 5
