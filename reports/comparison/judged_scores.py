"""The scores that simulators are judged by: names, number formats and which direction is better."""

from __future__ import annotations

from dataclasses import dataclass

from reports.scores.metrics import Metric

OF_CONTACT = "contact_"
CORRECTED = f"{OF_CONTACT}residual_corrected"
WRONG = f"{OF_CONTACT}residual_of_rival"


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """A column of the table.

    Attributes:
        key: As ``means`` of a simulator has it.
        digits: That are shown.
        factor: From SI to ``unit``.
        larger_is_better: None where the score is no error.
    """

    key: str
    label: str
    digits: int
    larger_is_better: bool | None
    unit: str = ""
    factor: float = 1.0

    @property
    def heading(self) -> str:
        """Label and unit."""
        return f"{self.label} ({self.unit})" if self.unit else self.label


FRAME = tuple(
    Score(key=m.value, label=m.heading, digits=m.decimals, larger_is_better=m.larger_is_better)
    for m in Metric
)
"""Of the whole frame."""
CONTACT = (
    Score(
        key=f"{OF_CONTACT}relative_residual",
        label="Contact residual",
        digits=3,
        larger_is_better=False,
    ),
    Score(
        key=WRONG,
        label="Residual of the best wrong press",
        digits=3,
        larger_is_better=None,
    ),
    Score(
        key=CORRECTED,
        label="Residual without translation and light",
        digits=3,
        larger_is_better=False,
    ),
    Score(key=f"{OF_CONTACT}zncc", label="Contact ZNCC", digits=3, larger_is_better=True),
    Score(
        key=f"{OF_CONTACT}error_levels",
        label="Mean error inside",
        digits=2,
        larger_is_better=False,
        unit="grey levels",
    ),
    Score(
        key=f"{OF_CONTACT}ssim_crop",
        label="SSIM around the contact",
        digits=3,
        larger_is_better=True,
    ),
)
"""Of the contact alone."""
MECHANICS = (
    Score(
        key="force_error_relative",
        label="Force error at the measured depth",
        digits=1,
        larger_is_better=False,
        unit="%",
        factor=100.0,
    ),
    Score(
        key="depth_error_m",
        label="Depth error at the measured force",
        digits=3,
        larger_is_better=False,
        unit="mm",
        factor=1e3,
    ),
    Score(
        key="height_apart_rms_m",
        label="Surface difference from our replay, rms",
        digits=1,
        larger_is_better=None,
        unit="um",
        factor=1e6,
    ),
    Score(
        key="pressure_apart_relative",
        label="Pressure difference from our replay",
        digits=1,
        larger_is_better=None,
        unit="%",
        factor=100.0,
    ),
    Score(
        key="shear_apart_relative",
        label="Shear difference from our replay",
        digits=1,
        larger_is_better=None,
        unit="%",
        factor=100.0,
    ),
)
"""Of forces, surfaces, pressures and shear."""

ALL = (*FRAME, *CONTACT, *MECHANICS)
