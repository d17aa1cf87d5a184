"""Whether the judged presses are among those that something was fitted to."""

from __future__ import annotations

from dataclasses import replace

import pytest

from reports.comparison.fitted import fits_of
from reports.evidence.evidence import RunEvidence
from tacauchy_rig.core.imported import Imported
from tests.made_model import made_model


@pytest.mark.parametrize(
    ("source", "is_own"), [("39 ball presses in digit", True), ("39 ball presses in other", False)]
)
def test_optics_from_the_imported_folder_are_in_sample(
    evidence: RunEvidence, source: str, is_own: bool
) -> None:
    """An import is judged with optics that its own images gave: that is a warning."""
    imported = Imported(
        kind="csv", source="digit", has_clock=False, unknown=(), notes=(), trials=()
    )
    model = replace(made_model(), optics={"source": source}, modulus_factor=None)
    fits = fits_of(replace(evidence, model=model, imported=imported))
    (optics,) = [fit for fit in fits if fit.what.startswith("Optics")]
    assert optics.in_sample is is_own
    assert ("these same presses" in optics.source) is is_own


def test_a_fitted_modulus_is_in_sample_and_a_stated_one_is_not(evidence: RunEvidence) -> None:
    """The first row says which, and that predicted forces do not use the fit."""
    for factor in (None, 1.1):
        model = replace(made_model(), modulus_factor=factor, modulus_trials=6)
        fit = fits_of(replace(evidence, model=model))[0]
        assert fit.in_sample is (factor is not None)
        assert "redicted forces" in fit.effect
