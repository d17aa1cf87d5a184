"""Residuals of pose and light that were put in come out again, and raw scores stay raw."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from reports.comparison.results import ValidationReport
from reports.scores.contact import contact_footprint, image_change
from reports.scores.correction import correct, fit_light, register_changes, shift_change


def test_pose_and_light_are_recovered(report: ValidationReport, made: SimpleNamespace) -> None:
    """Shift within 0.2 px and gain within 0.5 % of what was put in, in every trial."""
    for trial in report.trials:
        fitted = trial.corrections
        assert fitted is not None
        assert fitted.pose is not None
        assert fitted.light is not None
        assert fitted.pose.x_px == pytest.approx(made.TRUE_POSE_PX[0], abs=0.2)
        assert fitted.pose.y_px == pytest.approx(made.TRUE_POSE_PX[1], abs=0.2)
        assert fitted.pose.x_mm == pytest.approx(fitted.pose.x_px * 0.0634, rel=1e-9)
        assert fitted.light.gain == pytest.approx((made.TRUE_GAIN,) * 3, abs=0.005)


def test_correction_explains_more_and_leaves_the_raw_score(report: ValidationReport) -> None:
    """Corrected scores stand beside raw ones and are better here."""
    for trial in report.trials:
        assert trial.corrections is not None
        corrected = trial.corrections.contact_pose_light_corrected
        assert trial.contact is not None
        assert corrected is not None
        assert corrected.relative_residual < 0.5 * trial.contact.relative_residual
        assert trial.corrections.metrics_pose_light_corrected is not None
        assert trial.metrics is not None
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
    assert light is not None
    assert light.gain == pytest.approx((1.05,) * 3, abs=0.01)


def test_nothing_is_corrected_without_a_contact(made: SimpleNamespace) -> None:
    """No contact in the real image, no correction."""
    reference = made.to_image(made.background())
    assert correct(reference, reference, reference) is None
