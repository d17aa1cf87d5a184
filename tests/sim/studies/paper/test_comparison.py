"""Ours beside the paper's, as rows, page and figure."""

from sim.studies.paper.claims import Verdict, claims
from sim.studies.paper.study import (
    compared,
    counts,
    mode_ours,
    model_ours,
    paper_figure,
    score_ours,
    speed_ours,
    worst,
)
from tests.sim.studies.paper.made_up import model, presses, report, speeds


def test_without_measurements_nothing_is_reproduced() -> None:
    """Every claim is there, as not reproduced or out of scope."""
    found = compared({})
    assert len(found) == len(claims())
    assert {row.verdict for row in found.values()} == {Verdict.NOT_REPRODUCED, Verdict.OUT_OF_SCOPE}
    assert sum(counts(found).values()) == len(found)


def test_an_emulated_run_is_no_answer_to_the_papers_scores() -> None:
    """A real one is, with its ends; a real one without simulated images is not."""
    assert score_ours([report(emulated=True, ours=True), report(emulated=False, ours=False)]) == {}
    found = score_ours([report(emulated=False, ours=True)])
    assert found["scores.ssim"].value == 0.5
    assert found["ends.mse_most"].value == 0.5
    assert set(found) <= set(claims())


def test_a_changed_measurement_changes_the_verdict() -> None:
    """The paper's model is different at twice the force, and reproduced at the reference's."""
    reference = model("reference")
    for force, verdict in ((6.0, Verdict.DIFFERENT), (3.1, Verdict.REPRODUCED)):
        measured = model_ours(presses(paper_force_n=force), reference, rest_stress_pa=1e5)
        found = compared(measured)
        assert found["model.force"].verdict is verdict
        assert found["model.sigma_thin"].verdict is Verdict.DIFFERENT
        assert found["model.force_ours"].verdict is Verdict.REPRODUCED


def test_ten_times_the_papers_speed_is_better_on_another_machine() -> None:
    """All frames, each environment's, and the time of a step."""
    found = compared(speed_ours(speeds()))
    for name in ("single", "sixty", "sixty_each", "stress"):
        assert found[f"speed.{name}"].verdict is Verdict.BETTER


def test_a_figure_is_as_good_as_its_worst_claim() -> None:
    """One contact mode with a missed criterion is enough."""
    modes = {"press": [True], "slide": [True, False], "twist": [True], "sensors": [True]}
    found = compared(mode_ours(modes))
    assert found["modes.press"].verdict is Verdict.REPRODUCED
    assert worst(found, "modes") is Verdict.DIFFERENT


def test_a_figure_has_a_bar_for_every_score() -> None:
    """The paper's alone without reports; one adds no contact, and ours."""
    for reports, count in (([], 1), ([report(emulated=True, ours=True)], 3)):
        *_, scores = paper_figure(presses(), reports).axes
        assert len(scores.patches) == count
