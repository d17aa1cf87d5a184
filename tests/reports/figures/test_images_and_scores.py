"""Differences of images: the scale of their colours reaches to the largest."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from reports.comparison.result_types import ValidationReport
from reports.figures.difference_colours import (
    LEAST_LIMIT,
    color_difference,
    difference_scale,
    luminance_difference,
)
from reports.figures.images_and_scores import draw_matrices
from reports.page.summary_and_junit import write_report


def test_no_difference_is_beyond_the_scale(report: ValidationReport) -> None:
    """Not even one pixel that is 120 levels off, and one level still shows beside it."""
    evidence = report.evidence
    image = evidence.trials[2].simulated_image
    spoiled = image.copy()
    spoiled[10, 20] = np.where(image[10, 20] < 128, image[10, 20] + 120, image[10, 20] - 120)
    trials = tuple(
        replace(trial, simulated_image=spoiled) if trial.index == 3 else trial
        for trial in evidence.trials
    )
    scale = difference_scale(map(luminance_difference, trials))
    difference = luminance_difference(trials[2])
    assert difference is not None
    assert scale.vmax is not None
    assert 110.0 <= np.abs(difference).max() <= scale.vmax <= 130.0
    even, one, most = color_difference(np.array([[0.0, 1.0, scale.vmax]]), scale)[0].astype(int)
    assert even.min() > 240
    assert 15 < np.abs(one - even).max() < np.abs(most - even).max()


def test_equal_images_have_a_scale_too(report: ValidationReport) -> None:
    """Of a few levels, so that rounding does not look like an error."""
    trials = tuple(
        replace(trial, simulated_image=trial.images and trial.images.real)
        for trial in report.evidence.trials
    )
    assert difference_scale(map(luminance_difference, trials)).vmax == LEAST_LIMIT


def test_matrices_are_in_the_order_of_the_forces(report: ValidationReport) -> None:
    """Whatever order presses were imported in; one without a force comes last."""
    matrix = report.matrices[0]
    shuffled = (3, 0, 5, 1, 4, 2)
    mixed = replace(
        matrix,
        trials=tuple(matrix.trials[k] for k in shuffled),
        forces_n=tuple(matrix.forces_n[k] for k in shuffled),
        values=tuple(tuple(matrix.values[i][k] for k in shuffled) for i in shuffled),
    )
    drawn = [draw_matrices(replace(report, matrices=(m,))).axes[0] for m in (matrix, mixed)]
    labels = [[label.get_text() for label in axes.get_yticklabels()] for axes in drawn]
    assert labels[0] == labels[1] == sorted(labels[0])
    np.testing.assert_array_equal(*(axes.images[0].get_array() for axes in drawn))


def without_a_term(report: ValidationReport, name: str) -> ValidationReport:
    """Return a report whose first press, of the smallest force, lacks a term of its budget."""
    first, *others = report.trials
    budget = tuple(term for term in first.force.budget if term.name != name)
    assert len(budget) == len(first.force.budget) - 1
    trials = (replace(first, force=replace(first.force, budget=budget)), *others)
    return replace(report, trials=trials)


@pytest.mark.usefixtures("undrawn")
def test_a_term_of_some_presses_stands_in_its_own_row(
    report: ValidationReport, tmp_path: Path
) -> None:
    """A ball has no fillet: what comes after it in a punch's budget is not taken for it."""
    last = report.trials[-1].force
    known = [term for term in last.budget if term.value_n]
    name, value_n = max(((term.name, term.value_n) for term in known), key=lambda t: t[1] or 0.0)
    lacking = without_a_term(report, name)
    assert value_n is not None
    page = write_report(lacking, tmp_path).html.read_text("utf-8")
    (cells,) = re.findall(rf"<th>[a-z]+: {re.escape(name)}</th>(.*?)</tr>", page)
    assert cells.startswith("<td>&ndash;</td>")
    share = 100.0 * (value_n / last.combined.value_n) ** 2
    assert cells.endswith(f"<td>{share:.1f}</td>")
