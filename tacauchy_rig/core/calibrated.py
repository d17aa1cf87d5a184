"""What ball presses of a run gave when its optics were calibrated from them: ``optics.json``."""

from __future__ import annotations

from dataclasses import dataclass

IMAGES_SHA256 = "images_sha256"
"""Of a calibration file: SHA-256 of each press that it was fitted to, of pixels and of its file."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageAgreement:
    """Presses rendered by a model that had not seen them, beside the no-contact frame.

    Attributes:
        r2: Share of the variance of the colour change explained inside the contacts.
        mae_levels: Mean absolute error inside the contacts [grey levels].
        ssim: Of a square around each contact, mean over presses.
    """

    r2: float
    mae_levels: float
    ssim: float
    r2_no_contact: float
    mae_no_contact_levels: float
    ssim_no_contact: float


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOutPress:
    """One press as the other folds' model renders it; its image lies beside the calibration.

    Attributes:
        contact_px: Column, row and radius of its contact as labelled or found [px].
        nudged_px: By how much the image has them elsewhere [px].
        mae_levels: Mean absolute error inside the contact [grey levels].
    """

    trial: int
    contact_px: tuple[float, float, float]
    nudged_px: tuple[float, float, float]
    mae_levels: float


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibratedOptics:
    """A calibration from a run's own presses, cross-validated.

    Attributes:
        labelled: Contacts were drawn by somebody; otherwise they were found in the images.
        scale_px_m: Pixels per metre along columns and rows, as stated.
        crop_px: Side of the square that SSIM is of [px].
        nudged: Circles moved to where the image has them, in each frame's own light.
        as_labelled: Circles as labelled or found, in each frame's own light.
        no_contact_light: Circles as labelled or found, in the no-contact frame's light.
    """

    ball_diameter_m: float
    scale_px_m: tuple[float, float]
    sensor: str
    preset: str
    labelled: bool
    folds: int
    crop_px: int
    nudged: ImageAgreement
    as_labelled: ImageAgreement
    no_contact_light: ImageAgreement
    presses: tuple[HeldOutPress, ...]
    warnings: tuple[str, ...] = ()
