"""What a twin is asked for, and what it shows of it."""

from __future__ import annotations

from dataclasses import dataclass

from tacauchy_rig.core.arrays import FloatArray, ImageArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Goal:
    """Where the gel stands now: one of force and depth is given.

    Attributes:
        stamp_s: When that was measured, on any clock that goes on evenly [s].
        force_n: Tared pressing force F_z [N].
        depth_m: Travel below first touch [m].
    """

    stamp_s: float
    force_n: float | None = None
    depth_m: float | None = None

    @property
    def touches(self) -> bool:
        """Whether anything is pressed."""
        return (self.depth_m or 0.0) > 0.0 or (self.force_n or 0.0) > 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class TwinFrame:
    """The twin at one goal.

    Attributes:
        goal: What it was asked for.
        force_n: Its F_z [N]; zero where nothing touches.
        force_error_n: Stated error [N]: 95 % of such presses err by less; None where nobody
            knows.
        depth_m: Travel below first touch [m].
        image: What the camera would show, RGB, uint8, shape [height, width, 3].
        pressure_pa: On the gel where the image's pixels look, shape [rows, columns]; None where
            it was not asked for.
        shear_pa: Size of the tangential traction there, likewise.
        solve_s: Time that the press took [s].
        draw_s: Time that image and maps took [s].
        note: Why the frame is not of its goal; empty where it is.
    """

    goal: Goal
    force_n: float
    force_error_n: float | None
    depth_m: float
    image: ImageArray
    pressure_pa: FloatArray | None
    shear_pa: FloatArray | None
    solve_s: float
    draw_s: float
    note: str = ""
