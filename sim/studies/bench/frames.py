"""Twenty frames of a travel of 1 mm into a gel: how many a second."""

from __future__ import annotations

from dataclasses import dataclass

TRAVEL_M = 1e-3
FRAME_COUNT = 20
FORCE_ERROR_MAX = 0.03


@dataclass(frozen=True, slots=True, kw_only=True)
class TimedFrames:
    """A travel in frames on one mesh, in one environment or many side by side.

    Attributes:
        wall_s: All frames of all environments, the least of several [s].
        force_error: F_z of the last frame in the first environment over that of preset accurate,
            less one.
    """

    tet_count: int
    unknown_count: int
    wall_s: float = float("nan")
    force_error: float = float("nan")

    @property
    def frame_ms(self) -> float:
        """Time of a frame of all environments [ms]."""
        return 1e3 * self.wall_s / FRAME_COUNT

    @property
    def frames_per_s(self) -> float:
        """Frames of all environments together [1/s]."""
        return FRAME_COUNT * self._travelling / self.wall_s

    @property
    def _travelling(self) -> int:
        """Environments whose frames count."""
        raise NotImplementedError
