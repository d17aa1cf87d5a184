"""What a run asks of a simulator, and what one gives of its presses. All SI."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray


class Driven(StrEnum):
    """What a simulator was told of a press: the other one of force and depth is its answer."""

    DEPTH = "depth"
    FORCE = "force"


@dataclass(frozen=True, slots=True, kw_only=True)
class Simulator:
    """Who simulated.

    Attributes:
        version: As its maker numbers it.
        milliseconds_an_image: From the press's depth or force to the image [ms]; None: not stated.
        machine: That this was measured on.
        fitted_to_these: Something of it was fitted to the very presses that are judged.
        driven_by: What it was told; None where it gives no force.
        note: What a reader has to know, in a sentence.
    """

    name: str
    version: str
    milliseconds_an_image: float | None = None
    machine: str = ""
    fitted_to_these: bool = False
    driven_by: Driven | None = None
    note: str = ""

    @property
    def title(self) -> str:
        """Name and version."""
        return f"{self.name} {self.version}"


@dataclass(frozen=True, slots=True, kw_only=True)
class PressOutput:
    """One press, simulated.

    Attributes:
        image: RGB, of the scored size, shape [height, width, 3].
        force_n: F_z on the indenter, positive in compression [N].
        depth_m: From first touch [m].
        height_m: Height of the gel's surface over itself at rest [m], negative where it is pressed
            in, a value a pixel of the scored image, shape [height, width].
        pressure_pa: Normal pressure on the gel, likewise [Pa].
        shear_pa: Tangential traction on the gel along the pad's x and y [Pa], shape
            [height, width, 2].
    """

    image: NDArray[np.uint8] | None = None
    force_n: float | None = None
    depth_m: float | None = None
    height_m: NDArray[np.float64] | None = None
    pressure_pa: NDArray[np.float64] | None = None
    shear_pa: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Outputs:
    """All presses of a simulator, by the run's trial.

    Attributes:
        left_out: Trials that it says it did not simulate.
    """

    simulator: Simulator
    presses: dict[int, PressOutput] = field(default_factory=dict)
    left_out: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class AskedPress:
    """One press; None is not known.

    Attributes:
        depth_m: Below the height at which F_z was ``Task.contact_force_n`` [m].
        place_x_m: Of the tip, in the pad's frame [m].
        indenter: As ``press --indenter`` has it.
    """

    press: int
    force_n: float | None
    depth_m: float | None
    place_x_m: float | None
    place_y_m: float | None
    indenter: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """All presses of a run, and what they share.

    Attributes:
        sensor: Name of its file.
        friction: Coulomb coefficient.
        centre_x_px: Column of the scored image that sees the pad's centre.
        rows_grow_with_y: Rows of the image grow with the pad's y where columns grow with x.
    """

    run: str
    sensor: str
    friction: float
    contact_force_n: float
    width_px: int
    height_px: int
    scale_x_m_px: float
    scale_y_m_px: float
    centre_x_px: float
    centre_y_px: float
    rows_grow_with_y: bool
