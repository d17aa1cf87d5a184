"""The figure of a run's objects: which presses it has, and what it says of them."""

from __future__ import annotations

from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest

from reports.comparison.objects import ObjectPress, object_presses
from reports.evidence.evidence import RunEvidence
from reports.figures.objects import chosen, draw_objects
from tacauchy_rig.core.errors import RecordError

KINDS = ("sphere:diameter=6mm", "cylinder:diameter=5mm,fillet=0.1mm")


@pytest.fixture
def presses(evidence: RunEvidence) -> list[ObjectPress]:
    """Six presses of two objects, by turns."""
    indenters = {trial.index: KINDS[trial.index % 2] for trial in evidence.trials}
    images = {t.index: t.simulated_image for t in evidence.trials if t.simulated_image is not None}
    return object_presses(evidence, indenters, images)


def test_presses_are_scored_beside_no_contact(
    presses: list[ObjectPress], evidence: RunEvidence
) -> None:
    """Object by object, each better than its own no-contact frame."""
    assert [press.indenter for press in presses] == [KINDS[1]] * 3 + [KINDS[0]] * 3
    for press in presses:
        assert press.scores.psnr_db > press.no_contact.psnr_db
        assert press.trial in evidence.trials


def test_objects_share_the_rows(presses: list[ObjectPress]) -> None:
    """Three presses each of two objects; of many objects one each, that of the largest force."""
    assert chosen(presses) == presses
    other = [replace(press, indenter=f"{k}") for k in range(7) for press in presses[:2]]
    rows = chosen(other)
    assert [row.indenter for row in rows] == [f"{k}" for k in range(7)]
    assert {row.trial.force_target_n for row in rows} == {presses[1].trial.force_target_n}


def test_figure_says_whose_images_and_what_they_score(presses: list[ObjectPress]) -> None:
    """Emulated ones are called so; the scale holds the largest difference."""
    figure = draw_objects(presses, camera="emulated", simulator="ours", marks=("SIMULATED",))
    titles = [axes.get_title() for axes in figure.axes]
    assert titles[:3] == ["Emulated", "Simulated: ours", "Simulated − emulated"]
    told = "\n".join(text.get_text() for axes in figure.axes for text in axes.texts)
    for press in presses:
        assert f"{press.scores.ssim:.4f}, {press.scores.psnr_db:.2f} dB" in told
        assert f"{press.no_contact.ssim:.4f}, {press.no_contact.psnr_db:.2f} dB" in told
    assert any(text.get_text() == "SIMULATED" for text in figure.texts)
    differences = [axes.images[0] for axes in figure.axes if axes.get_title() == titles[2]]
    norm = differences[0].norm
    assert isinstance(norm, mpl.colors.AsinhNorm)
    largest = max(
        np.abs(axes.images[0].get_array()).max()
        for axes in figure.axes
        if axes.images and np.ndim(axes.images[0].get_array()) == 2
    )
    assert norm.vmax is not None
    assert largest <= norm.vmax < largest + 1.0


def test_without_simulated_images_there_is_no_figure(evidence: RunEvidence) -> None:
    """And what makes them is said."""
    with pytest.raises(RecordError, match="no press has both") as caught:
        object_presses(evidence, {}, {})
    assert "tacauchy-rig replay RUN" in caught.value.remedy
