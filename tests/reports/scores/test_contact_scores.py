"""Contact scores on a punch mark whose place, size and strength are known."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from reports.comparison.result_types import ValidationReport
from reports.evidence.evidence_types import TrialImages
from reports.scores.contact_scores import (
    contact_crop,
    contact_footprint,
    correct,
    fit_light,
    footprint_radius,
    image_change,
    register_changes,
    score_contact,
    shift_change,
)


def scored(real: Any, simulated: Any, reference: Any, **scale: Any) -> Any:
    """Score a contact of three images."""
    return score_contact(TrialImages(real=real, reference=reference), simulated, **scale)


def test_identical_contact(made: SimpleNamespace) -> None:
    """A perfect simulation scores 1, 0, 1, 0."""
    pressed = made.to_image(made.background() + made.contact_change(4.0))
    reference = made.to_image(made.background())
    scores = scored(pressed, pressed, reference)
    assert scores.zncc == pytest.approx(1.0)
    assert scores.relative_residual == 0.0
    assert scores.mask_iou == 1.0
    assert scores.error_levels == 0.0
    assert scores.ssim_crop == pytest.approx(1.0)
    assert scores.centroid_error_px == 0.0
    assert scores.centroid_error_mm is None


def test_half_the_amplitude_is_half_unexplained(made: SimpleNamespace) -> None:
    """A contact of half the strength keeps place and shape and leaves half of the norm."""
    reference = made.to_image(made.background())
    real = made.to_image(made.background() + made.contact_change(4.0))
    weak = made.to_image(made.background() + made.contact_change(2.0))
    scores = scored(real, weak, reference)
    assert scores.relative_residual == pytest.approx(0.5, abs=0.02)
    assert scores.zncc > 0.99
    assert scores.mask_iou > 0.95


@pytest.mark.parametrize("shift", [(6.0, 0.0), (-3.0, 4.0)])
def test_distance_of_a_shifted_contact(made: SimpleNamespace, shift: tuple[float, float]) -> None:
    """The centroids lie apart by the shift, in pixels and in mm."""
    reference = made.to_image(made.background())
    center = (160.0 + shift[0], 120.0 + shift[1])
    real = made.to_image(made.background() + made.contact_change(4.0, center_px=center))
    simulated = made.to_image(made.background() + made.contact_change(4.0))
    scores = scored(real, simulated, reference, scale_mm_px=(0.06, 0.06))
    assert scores.centroid_error_px == pytest.approx(math.hypot(*shift), abs=0.4)
    assert scores.centroid_error_mm == pytest.approx(0.06 * math.hypot(*shift), abs=0.03)


def test_no_contact_leaves_everything_unexplained(made: SimpleNamespace) -> None:
    """The no-contact frame in place of the simulation leaves the whole norm, overlap 0."""
    reference = made.to_image(made.background())
    real = made.to_image(made.background() + made.contact_change(4.0))
    scores = scored(real, reference, reference)
    assert scores.relative_residual == 1.0
    assert scores.mask_iou == 0.0
    assert math.isnan(scores.centroid_error_px)


def test_error_is_of_the_region_alone(made: SimpleNamespace) -> None:
    """What differs outside the contact is no error of it, what differs inside is, by its size."""
    reference = made.to_image(made.background())
    real = made.to_image(made.background() + made.contact_change(4.0))
    footprint = contact_footprint(image_change(real, reference))
    rows, columns = contact_crop(footprint)
    beside, inside = real.copy(), real.copy()
    beside[:10, :10] += np.uint8(9)
    inside[footprint] += np.uint8(3)
    assert scored(real, beside, reference).error_levels == 0.0
    error = scored(real, inside, reference).error_levels
    assert 1.5 < error < 3.0  # of the footprint 3, of the margin around it nothing
    assert rows.stop - rows.start == columns.stop - columns.start
    assert footprint[rows, columns].sum() == footprint.sum()


def test_crop_lies_within_a_small_image() -> None:
    """A mark in a corner of an image gets a square that lies in it, however large it is."""
    footprint = np.zeros((20, 30), dtype=np.bool_)
    footprint[:3, 26:] = True
    rows, columns = contact_crop(footprint)
    assert (rows.start, columns.stop) == (0, 30)
    assert rows.stop - rows.start == columns.stop - columns.start == 16
    footprint[:] = True
    rows, columns = contact_crop(footprint)
    assert (rows.start, rows.stop, columns.start, columns.stop) == (0, 20, 0, 30)


def test_noise_is_no_contact(made: SimpleNamespace) -> None:
    """Camera noise and a change of the light alone show no footprint."""
    rng = np.random.default_rng(2)
    reference = made.to_image(made.background())
    noisy = made.to_image(1.03 * made.background() + rng.normal(0, 2, reference.shape))
    assert contact_footprint(image_change(noisy, reference)) is None
    assert scored(noisy, reference, reference) is None


def test_footprint_survives_noise_and_light(made: SimpleNamespace) -> None:
    """The footprint under noise and 3 % more light has the radius of the clean one."""
    rng = np.random.default_rng(3)
    reference = made.to_image(made.background())
    pressed = made.background() + made.contact_change(3.0)
    clean = contact_footprint(image_change(made.to_image(pressed), reference))
    noisy_image = made.to_image(1.03 * pressed + rng.normal(0, 1.5, reference.shape))
    noisy = contact_footprint(image_change(noisy_image, reference))
    assert clean is not None
    assert noisy is not None
    assert footprint_radius(noisy) == pytest.approx(footprint_radius(clean), abs=2.0)
    assert footprint_radius(clean) == pytest.approx(made.PUNCH_RADIUS_PX, abs=12.0)


def test_region_comes_from_the_real_image(made: SimpleNamespace) -> None:
    """A simulated mark elsewhere cannot move the region away from where it fails."""
    reference = made.to_image(made.background())
    real = made.to_image(made.background() + made.contact_change(4.0, center_px=(110.0, 120.0)))
    elsewhere = made.to_image(
        made.background() + made.contact_change(4.0, center_px=(240.0, 120.0))
    )
    scores = scored(real, elsewhere, reference)
    assert scores.relative_residual > 0.9
    assert abs(scores.zncc) < 0.3


def test_pose_and_light_are_recovered(report: ValidationReport, made: SimpleNamespace) -> None:
    """Shift within 0.2 px and gain within 0.5 % of what was put in, in every trial."""
    for trial in report.trials:
        fitted = trial.corrections
        assert fitted.pose.x_px == pytest.approx(made.TRUE_POSE_PX[0], abs=0.2)
        assert fitted.pose.y_px == pytest.approx(made.TRUE_POSE_PX[1], abs=0.2)
        assert fitted.pose.x_mm == pytest.approx(fitted.pose.x_px * 0.0634, rel=1e-9)
        assert fitted.light.gain == pytest.approx((made.TRUE_GAIN,) * 3, abs=0.005)


def test_correction_explains_more_and_leaves_the_raw_score(report: ValidationReport) -> None:
    """Corrected scores stand beside raw ones and are better here."""
    for trial in report.trials:
        corrected = trial.corrections.contact_pose_light_corrected
        assert corrected.relative_residual < 0.5 * trial.contact.relative_residual
        assert trial.corrections.metrics_pose_light_corrected.mse < trial.metrics.mse


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.5, -0.25), (7.0, 5.0), (-12.0, 3.0)])
def test_registration_finds_the_shift(made: SimpleNamespace, shift: tuple[float, float]) -> None:
    """Without noise the translation is found to 0.05 px, also when the contact is weaker."""
    simulated = made.contact_change(3.0)
    real = made.contact_change(4.0, center_px=(160.0 + shift[0], 120.0 + shift[1]))
    footprint = contact_footprint(real)
    assert footprint is not None
    found = register_changes(real, simulated, footprint)
    assert found == pytest.approx(shift, abs=0.05)


def test_registration_gives_up_far_away(made: SimpleNamespace) -> None:
    """A contact that does not overlap is not registered to a made-up place."""
    real = made.contact_change(4.0, center_px=(70.0, 70.0))
    footprint = contact_footprint(real)
    assert footprint is not None
    simulated = np.zeros_like(real)
    assert register_changes(real, simulated, footprint) is None


def test_shift_keeps_unchanged_gel_unchanged() -> None:
    """What a shift brings in from outside the frame is zero change."""
    change = np.ones((20, 30, 3))
    moved = shift_change(change, 5.0, 0.0)
    assert np.allclose(moved[:, :3], 0.0)
    assert np.allclose(moved[:, 10:], 1.0)


def test_light_fit_does_not_look_into_the_contact(made: SimpleNamespace) -> None:
    """A wrong contact leaves the fitted light alone."""
    reference = made.to_image(made.background())
    real = made.to_image(made.background() * 1.05 + made.contact_change(4.0))
    footprint = contact_footprint(image_change(real, reference))
    assert footprint is not None
    light = fit_light(real, reference, footprint)
    assert light.gain == pytest.approx((1.05,) * 3, abs=0.01)


def test_nothing_is_corrected_without_a_contact(made: SimpleNamespace) -> None:
    """No contact in the real image, no correction."""
    reference = made.to_image(made.background())
    assert correct(TrialImages(real=reference, reference=reference), reference) is None
