"""``tacauchy-rig study``: what is listed, selected, measured, kept and written, and how it ends."""

import json
import shlex
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner, Result

from sim.press import press
from sim.press_arguments import scene_from
from sim.scene.scene import Preset
from sim.studies import from_file
from sim.studies.verification import forces
from tacauchy_rig.app.cli.app import app
from tacauchy_rig.app.cli.output import documented
from tacauchy_rig.app.cli.studies import StudyRun
from tacauchy_rig.core import study as core
from tacauchy_rig.core.errors import AbortedError, ConfigError, RigError
from tacauchy_rig.core.study import Case, Study
from tacauchy_rig.core.tables import Table, table_of
from tests.tacauchy_rig.app.cli.measures import (
    count,
    crashes,
    hangs,
    interrupted,
    nine,
    raises,
    two,
)


def test_only_round_bodies_are_moved() -> None:
    """A plane has no axis to turn about."""
    done = CliRunner().invoke(app, ["study", "modes", "--indenter", "plane"])
    assert done.exit_code != 0
    assert "only round bodies" in str(done.exception)


def test_scenes_are_listed_without_pressing() -> None:
    """``--list`` names every scene."""
    done = CliRunner().invoke(app, ["study", "effects", "--list"])
    assert done.exit_code == 0
    assert "slow and lossy" in done.stdout


def test_a_scene_is_checked_and_written_down(tmp_path: Path) -> None:
    """One scene: a line, a row of the page, and JSON."""
    page, found = tmp_path / "effects.md", tmp_path / "effects.json"
    files = ("--out", str(page), "--json", str(found))
    done = CliRunner().invoke(app, ["study", "effects", "--only", "by force", *files])
    assert done.exit_code == 0, done.output
    assert "times the time with" in done.stderr
    text = page.read_text(encoding="utf-8")
    assert "All outputs were kept in 1 of 1 scenes" in text
    assert "| by force | inertia, gravity | " in text
    (scene,) = json.loads(found.read_text(encoding="utf-8"))["scenes"]
    assert scene["passed"] is True
    assert "gravity" in scene["added"]
    assert scene["differences"]["depth"] <= scene["tolerances"]["depth"]


def test_scenes_are_drawn_with_a_seed() -> None:
    """``--random`` and ``--seed`` name other scenes; nothing is pressed for a list."""
    listed = [
        CliRunner()
        .invoke(app, ["study", "effects", "--list", "--random", "3", "--seed", seed])
        .stdout
        for seed in ("1", "2", "1")
    ]
    assert listed[0] == listed[2] != listed[1]
    assert len(listed[0].splitlines()) == 3


def test_a_scene_that_takes_too_long_is_left_and_named(tmp_path: Path) -> None:
    """Nothing is lost in silence; it is no miss."""
    found = tmp_path / "found.json"
    limited = ["study", "effects", "--only", "by force", "--limit", "1 ms", "--json", str(found)]
    done = CliRunner().invoke(app, limited)
    assert done.exit_code == 0
    assert "not done after 0.001 s" in done.stderr
    assert list(json.loads(found.read_text("utf-8"))["not_pressed"]) == ["by force"]


def test_drawn_scenes_can_be_taken_one_by_one() -> None:
    """So that many may be parted over machines; a number beyond the last is refused."""
    drawn = ["study", "effects", "--random", "9", "--seed", "1", "--list"]
    whole, one = (
        CliRunner().invoke(app, [*drawn, *only]).stdout.splitlines()
        for only in ([], ["--only", "4"])
    )
    assert one == [whole[4]]
    beyond = CliRunner().invoke(app, [*drawn, "--only", "9"])
    assert "--only '9': no such scene" in str(beyond.exception)


def test_a_fast_case_is_printed_and_written(tmp_path: Path) -> None:
    """Case 14 alone, by its number: a table, a page and JSON, exit code 0."""
    numbers = tmp_path / "found.json"
    words = ["study", "hard-cases", "--only", "14", "--out", str(tmp_path), "--json", str(numbers)]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    assert "no contact: pass after" in done.stderr
    page = (tmp_path / "hard_cases.md").read_text()
    assert "**1 of 1 hard cases pass.**" in page
    (case,) = json.loads(numbers.read_text())["cases"]
    assert (case["number"], case["name"], case["passed"]) == (14, "no contact", True)
    assert case["measured"]["force_max_n"] == 0.0
    assert case["measured"]["iterations_before_touch"] == 0
    assert json.loads((tmp_path / "hard_cases.json").read_text())["cases"] == [case]


def test_one_section_is_shown_written_and_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With two coarse presses: table, page with title and command, JSON, progress on stderr."""
    stated = [each | {"allowed": 0.2} for each in from_file("verification/presses.toml")["punch"]]
    coarse = partial(forces.measure_punch, preset=Preset.FAST, stated=stated[:2])
    monkeypatch.setattr(forces, "measure_punch", coarse)
    page, numbers = tmp_path / "page.md", tmp_path / "numbers.json"
    words = ["study", "verify", "--only", "punch", "--out", str(page), "--json", str(numbers)]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    assert "kappa" in done.stdout
    assert "punch: met" in done.stderr
    text = page.read_text("utf-8")
    assert text.startswith("# Flat punch on a bonded layer")
    assert f"study verify --only punch --out {page}`" in " ".join(text.split())
    found = json.loads(numbers.read_text("utf-8"))
    assert [row[0] for row in found["sections"]["punch"]["rows"]] == [0.45, 0.47]
    assert "warp-lang" in found["versions"]
    again = CliRunner().invoke(app, [*words, "--resume", str(numbers)])
    assert "kappa" in again.stdout
    assert "punch" not in again.stderr


def test_the_pages_command_gives_the_pages_number(tmp_path: Path) -> None:
    """A scene pressed by its command and by the simulator give the same force."""
    disc = from_file("verification/presses.toml")["disc"]
    words = f"{disc} --depth 0.05mm --law neo-hookean --preset fast"
    numbers = tmp_path / "press.json"
    done = CliRunner().invoke(app, ["press", *shlex.split(words), "--json", str(numbers)])
    assert done.exit_code == 0
    force = json.loads(numbers.read_text("utf-8"))["force_n"][2]
    assert force == pytest.approx(press(scene_from(words)).force_n[2], rel=1e-8)


class Numbers(Study):
    """Numbers that have to be at most a limit."""

    name, title = "numbers", "Some numbers"

    def __init__(self, limit: float, cases: Sequence[Case]) -> None:
        self._limit, self._cases = limit, cases

    def cases(self) -> Sequence[Case]:
        """Return the cases of a test."""
        return self._cases

    def tables(self, results: Sequence[core.Result]) -> list[Table]:
        """Return the numbers."""
        known = [each for each in results if not each.failure]
        table = table_of(
            known,
            {"case": lambda each: each.name, "number": lambda each: each.found["number"]},
            title="Numbers",
            criterion=f"at most {self._limit:g}",
            passed=all(each.found["number"] <= self._limit for each in known),
        )
        return [table, *core.failures_table(results)]


TWO = Case(name="two", measure=two, shows="a small one", alias="1")
NINE = Case(name="nine", measure=nine)


def call(cases: Sequence[Case], *words: str, kind: type[Numbers] = Numbers) -> Result:
    """Run a command of a study with these cases."""

    def numbers(*, most: Annotated[float, typer.Option("--most")] = 5.0, how: StudyRun) -> None:
        """Measure numbers."""
        how.measure(kind(most, cases))

    app = typer.Typer()
    app.command()(documented(numbers))
    return CliRunner().invoke(app, words)


def test_what_is_measured_is_shown_written_and_kept(tmp_path: Path) -> None:
    """Into a folder: page and JSON with command, versions and machine; exit 0."""
    done = call([TWO], "--most", "3", "--out", str(tmp_path / "new"))
    assert done.exit_code == 0, done.output
    assert "met: at most 3" in done.stdout
    page = (tmp_path / "new" / "numbers.md").read_text()
    assert page.startswith("# Some numbers")
    assert "| two | 2 |" in page
    assert f"--most 3.0 --out {tmp_path / 'new'}`" in " ".join(page.split())
    kept = json.loads((tmp_path / "new" / "numbers.json").read_text())
    assert kept["results"][0]["found"] == {"number": 2.0}
    assert kept.keys() >= {"tables", "command", "commit", "machine", "versions", "open_count"}


def test_a_missed_criterion_and_a_failed_case_end_with_1() -> None:
    """The others are still measured; the failure is a row."""
    assert call([TWO, NINE]).exit_code == 1
    done = call([Case(name="bad", measure=raises), TWO])
    assert done.exit_code == 1
    assert "the press stopped at 3.1 mm" in done.stdout
    assert "two" in done.stdout


def test_cases_are_listed_and_selected_by_name_or_number() -> None:
    """An unknown one is refused with those that there are."""
    listed = call([TWO, NINE], "--list")
    assert [line.split()[0] for line in listed.stdout.splitlines()] == ["two", "nine"]
    assert "a small one" in listed.stdout
    for pattern in ("t*", "1"):
        assert "nine" not in call([TWO, NINE], "--only", pattern).stdout
    refused = call([TWO, NINE], "--only", "3")
    assert isinstance(refused.exception, ConfigError)
    assert "choose among two; nine" in refused.exception.remedy


def test_what_is_on_request_is_measured_only_if_it_is_named() -> None:
    """And then alone."""
    asked = Case(name="nine", measure=nine, on_request=True)
    assert call([TWO, asked]).exit_code == 0
    assert call([TWO, asked], "--only", "nine").exit_code == 1


def test_a_crash_and_a_hang_fail_their_case_alone() -> None:
    """In processes of their own, two at once, each within its limit."""
    hang = Case(name="hang", measure=hangs, limit_s=1.0)
    done = call([Case(name="crash", measure=crashes), hang, TWO], "--jobs", "2")
    assert done.exit_code == 1
    assert "its process ended with status -6" in done.stdout
    assert "not done after 1 s" in done.stdout
    assert "two" in done.stdout
    assert "not done after 0.5 s" in call([hang], "--limit", "0.5 s").stdout


def test_a_case_can_ask_for_a_process_of_its_own() -> None:
    """Without an option of the command."""
    done = call([Case(name="crash", measure=crashes, is_isolated=True), TWO])
    assert "its process ended with status -6" in done.stdout


def test_an_interrupted_study_leaves_what_was_measured_and_goes_on(tmp_path: Path) -> None:
    """Exit 3; the page says so; --resume measures the rest alone."""
    page, kept = tmp_path / "page.md", tmp_path / "kept.json"
    files = ("--out", str(page), "--json", str(kept))
    done = call([TWO, Case(name="stop", measure=interrupted)], *files)
    assert isinstance(done.exception, AbortedError)
    assert "interrupted: 1 of 2 cases" in done.stderr
    assert "| two | 2 |" in page.read_text()
    assert "Interrupted: 1 selected cases were not measured." in " ".join(page.read_text().split())
    again = [Case(name="two", measure=raises, shows="a small one"), NINE]
    done = call(again, "--resume", str(kept), "--most", "10")
    assert done.exit_code == 0, done.output
    assert "stopped" not in done.output


def test_a_failure_is_measured_again_if_it_is_named(tmp_path: Path) -> None:
    """Else its reason goes on to the next page."""
    kept = tmp_path / "kept.json"
    call([Case(name="two", measure=raises)], "--json", str(kept))
    better = [Case(name="two", measure=two)]
    assert call(better, "--resume", str(kept)).exit_code == 1
    assert call(better, "--resume", str(kept), "--only", "two").exit_code == 0


def test_a_file_of_another_study_is_refused(tmp_path: Path) -> None:
    """And one that is no JSON of results."""
    kept = tmp_path / "kept.json"
    call([TWO], "--json", str(kept))
    other = call([Case(name="two", measure=two, shows="another")], "--resume", str(kept))
    assert "two differs there" in str(other.exception)
    kept.write_text("{}")
    assert f"--resume {kept}" in str(call([TWO], "--resume", str(kept)).exception)


def test_options_that_a_study_cannot_have_are_refused(tmp_path: Path) -> None:
    """Cases that go on from one another stay in one process; drawn presses are not kept."""

    class Together(Numbers):
        is_together, is_resumable = True, False

    for words in (("--jobs", "2"), ("--limit", "1 s"), ("--resume", "x.json")):
        assert isinstance(call([TWO], *words, kind=Together).exception, ConfigError)
    taken = tmp_path / "file"
    taken.write_text("not a folder")
    assert isinstance(call([TWO], "--out", str(taken)).exception, RigError)


@pytest.mark.parametrize("jobs", [1, 2])
def test_cases_of_one_process_find_what_the_one_before_loaded(jobs: int) -> None:
    """Others do not."""
    cases = [Case(name=f"{k}", measure=count, process=name) for k, name in enumerate("aab")]
    found = {r.name: r.found for r in core.measured(cases, jobs=jobs, limit_s=60.0)}
    assert found == {"0": 1, "1": 2, "2": 1}
