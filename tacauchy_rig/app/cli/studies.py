"""``tacauchy-rig study``: the studies that a user runs, and the runner behind all studies."""

from __future__ import annotations

import json
import shlex
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import typer

from sim.scene.scene import Preset, SceneTerms
from sim.studies.bench import Part
from tacauchy_rig.app.cli import output
from tacauchy_rig.core.errors import AbortedError, ConfigError
from tacauchy_rig.core.quantities import Dimension, parse_quantity
from tacauchy_rig.core.study import About, Case, Result, Study, kept_results, measured, selected
from tacauchy_rig.core.versions import commit, machine, versions

if TYPE_CHECKING:
    from sim.optics.height.height_map import HeightMaps
    from tacauchy_rig.core.arrays import ImageArray


# Options that say how a study is run, not what it measures.
_UNSAID = ("jobs", "json_file", "resume", "list_only")


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyRun:
    """How a study is run, by the options that commands of all studies have.

    Args:
        only (PATTERN): Select cases by name; `*` matches anything; may be repeated.
        list_only: List the cases and stop.
        limit (TIME): A case that takes longer has failed.
        resume (FILE): JSON of an earlier run, whose results are taken; may be repeated. A case that
            failed there is measured again if --only names it.
        out (FILE.md|DIR): Write a page, its figures beside it in images; into DIR also JSON, and
            figures for print.
    """

    context: typer.Context
    only: list[str] | None = None
    list_only: Annotated[bool, typer.Option("--list")] = False
    jobs: output.Jobs = 1
    limit: str = ""
    resume: list[Path] | None = None
    out: Path | None = None
    json_file: output.JsonFile = None

    def measure(self, study: Study) -> None:
        """Measure the selected cases, show tables, and write page, figures and JSON."""
        limit_s = None
        if self.limit:
            limit_s = parse_quantity(self.limit, dimension=Dimension.TIME, field="--limit")
        if study.is_together and (self.jobs > 1 or limit_s is not None):
            raise ConfigError(
                f"the {study.kind}s of {study.name} go on from one another",
                remedy="leave out --jobs and --limit",
            )
        if self.resume and not study.is_resumable:
            raise ConfigError(
                f"{study.name} draws the presses themselves, which JSON does not keep",
                remedy="leave out --resume",
            )
        chosen = selected(
            study.cases(),
            [study.pattern(text) for text in self.only or ()],
            names=lambda case: (case.name, *filter(None, (case.alias,))),
            kind=study.kind,
        )
        if not self.only:
            chosen = tuple(case for case in chosen if self.list_only or not case.on_request)
        if self.list_only:
            for case in chosen:
                output.say(f"{case.name:22} {case.shows}".rstrip())
            return
        kept, out = kept_results(self.resume or [], chosen), self.out
        if self.only:
            kept = {name: each for name, each in kept.items() if not each.failure}
        elif out is None:
            out = study.page_file
        page = out if out is None or out.suffix == ".md" else out / f"{study.name}.md"
        own_json = None if page is None or page == out else page.with_suffix(".json")
        command = said_command(self.context)
        runner = _Runner(study, chosen, kept, command, page, own_json, self.json_file)
        runner.run(self.jobs, limit_s)


def said_command(context: typer.Context) -> str:
    """Return the command that was called, without what does not change its results."""
    words = context.command_path.split()
    for option in context.command.params:
        source = context.get_parameter_source(option.name or "")
        if option.name in _UNSAID or source is None or source.name != "COMMANDLINE":
            continue
        value = context.params[option.name]
        for each in value if isinstance(value, list | tuple) else (value,):
            words += [option.opts[0]] if isinstance(each, bool) else [option.opts[0], str(each)]
    return shlex.join(words)


@dataclass(slots=True)
class _Runner:
    study: Study
    cases: Sequence[Case]
    results: dict[str, Result]
    command: str
    page: Path | None
    own_json: Path | None  # beside the page; None where figures for print are not asked for either
    json_file: Path | None

    def run(self, jobs: int, limit_s: float | None) -> None:
        study, is_cut = self.study, False
        if self.page is not None:
            output.writable_folder(self.page.parent)
        wanted = [case for case in self.cases if case.name not in self.results]
        found = measured(wanted, jobs=jobs, limit_s=limit_s)
        self._write()
        try:
            with output.Steps() as step:
                for number, result in enumerate(found, start=1):
                    self.results[result.name] = result
                    said = result.failure or study.line(result)
                    step(f"{result.name}: {said}", number, len(wanted))
                    self._write()
        except KeyboardInterrupt:
            is_cut = True
            output.complain(
                f"interrupted: {len(self._done)} of {len(self.cases)} cases are done and kept"
            )
        done = self._done
        for table in study.tables(done) if done else ():
            output.show_table(table)
        if self.page is not None:
            drawn = self._drawn(self.page) if done else []
            beside = [file for file in drawn if file.parent == self.page.parent / "images"]
            self._write([f"images/{file.name}" for file in beside])
            written = [*(file for file in drawn if file.exists()), self.page, self.own_json]
            for path in filter(None, written):
                output.say(str(path))
        if is_cut:
            raise AbortedError("aborted by Ctrl-C")
        raise typer.Exit(0 if study.has_passed(done) else 1)

    @property
    def _done(self) -> list[Result]:
        """The results that are there, in the order of the cases."""
        return [self.results[case.name] for case in self.cases if case.name in self.results]

    def _write(self, images: Sequence[str] = ()) -> None:
        """Write page and JSON of what is there, after every case."""
        done = self._done
        if not done:
            return
        about = About(self.command, commit(), len(self.cases) - len(done))
        if self.page is not None:
            output.write_text(self.page, self.study.page(done, about, images))
        facts = {
            **self.study.facts(done),
            "results": done if self.study.is_resumable else [],
            **about._asdict(),
            "machine": machine(),
            "versions": versions(),
        }
        for file in filter(None, (self.json_file, self.own_json)):
            output.write_json(file, facts)

    def _drawn(self, page: Path) -> list[Path]:
        from matplotlib import rc_context

        from tacauchy_rig.core.plot_style import FRAMED_STYLE, STYLE, save_figure

        with ExitStack() as spare, rc_context(FRAMED_STYLE if self.study.is_framed else STYLE):
            folder = page.parent
            if self.own_json is None:
                folder = Path(spare.enter_context(TemporaryDirectory()))
            return [
                file
                for name, figure in self.study.figures(self._done).items()
                for file in save_figure(figure, folder, name, page_folder=page.parent / "images")
            ]


def accuracy(
    *,
    sensor: str = "gelsight-mini",
    indenter: str = "cylinder:diameter=5mm,fillet=0.1mm",
    force: str = "4.7332N",
    full: bool = False,
    seed: list[int] | None = None,
    tolerances: bool = False,
    how: StudyRun,
) -> None:
    """Press with many settings; compare their errors and times.

    Example: tacauchy-rig study accuracy --sensor digit --force 2N --out accuracy

    Args:
        full: Measure many more settings.
        seed: Draws meshes of about the same sizes; 0: the presets' own. The first is compared with
            the others. May be repeated.
        tolerances: Test --tolerance on twenty scenes.
    """
    from sim.studies.accuracy.study import Accuracy

    terms = SceneTerms(indenter=indenter, sensor=sensor, force=force)
    how.measure(Accuracy(terms, _similarity, full=full, seeds=seed or (0,), tolerances=tolerances))


def _similarity(exact: ImageArray, found: ImageArray, maps: HeightMaps) -> tuple[float, float]:
    import numpy as np

    from reports.scores.image_metrics import structural_similarity_index, zero_mean_correlation
    from sim.optics.render.renderer import GREY_LEVEL

    inside = maps.contact
    changes = [image.astype(np.float64)[inside] - GREY_LEVEL for image in (exact, found)]
    return structural_similarity_index(exact, found), zero_mean_correlation(*changes)


def hard_cases(how: StudyRun) -> None:
    """Simulate hard cases, each in its own process.

    Example: tacauchy-rig study hard-cases --only 1 --only 14
    """
    from sim.studies.hard_cases.study import HardCases

    how.measure(HardCases())


def effects(*, random: int = 0, seed: int = 0, errors: bool = False, how: StudyRun) -> None:
    """Press scenes with their planned effects and with all; compare outputs and times.

    A scene has 60 s if --limit is not given; one that takes longer is left, and named.

    Example: tacauchy-rig study effects --only "by force"

    Args:
        random (N): Draw this many scenes instead.
        seed: Seed of the drawn scenes.
        errors: Compare the stated errors with a finer mesh too.
    """
    from sim.studies.effects.study import Effects

    how.measure(Effects(count=random, seed=seed, errors=errors))


def verify(how: StudyRun) -> None:
    """Compare presses with known solutions; takes minutes.

    Example: tacauchy-rig study verify --only punch --only hertz
    """
    from sim.studies.verification import Verification

    how.measure(Verification())


def modes(
    *,
    indenter: str = "cylinder:diameter=5mm,fillet=0.5mm",
    preset: Preset = Preset.FAST,
    how: StudyRun,
) -> None:
    """Press, slide and twist on a GelSight Mini; press a ball into three sensors; draw both.

    Example: tacauchy-rig study modes --out modes

    Args:
        indenter: cylinder:diameter=,fillet= or sphere:diameter=
    """
    from sim.studies.modes.study import Modes

    how.measure(Modes(indenter, preset))


def objects(
    *, sensors: str = "gelsight-mini,digit", preset: Preset = Preset.FAST, how: StudyRun
) -> None:
    """Press five objects, from sharp edges to smooth curves, and draw dents and tactile images.

    Example: tacauchy-rig study objects --out objects

    Args:
        sensors: Names or files, with commas between.
    """
    from sim.studies.objects.study import Objects

    how.measure(Objects(sensors, preset))


def paper(
    *,
    benchmarks: Path = Path("docs/results/benchmarks"),
    report: list[Path] | None = None,
    how: StudyRun,
) -> None:
    """Compare every number of the paper with ours: its model, benchmarks, reports.

    Example: tacauchy-rig study paper --out paper

    Args:
        benchmarks: Folder of the kept benchmarks.
        report (RUN): Keep this run's scores among the benchmarks, in place of those kept before;
            may be repeated.
    """
    from sim.studies.paper.kept_results import REPORTS_FILE, of_run
    from sim.studies.paper.study import Paper

    if report:
        kept = json.dumps([of_run(run) for run in report], indent=1)
        output.write_text(benchmarks / REPORTS_FILE, f"{kept}\n")
    how.measure(Paper(benchmarks))


def bench(
    *,
    sensor: str = "gelsight-mini",
    indenter: str = "cylinder:diameter=5mm,fillet=0.1mm",
    parts: Annotated[list[Part] | None, typer.Option("--part")] = None,
    drawn: int | None = None,
    tolerances: Annotated[list[str] | None, typer.Option("--tolerance")] = None,
    device: str = "cpu",
    environments: Annotated[list[int] | None, typer.Option(min=1)] = None,
    images: bool = False,
    reference: bool = False,
    against: Path | None = None,
    how: StudyRun,
) -> None:
    """Time images, a replay, batches and scenes; takes minutes.

    --only takes a part of a name: a part of the benchmark, or scenes.

    Example: tacauchy-rig study bench --part scenes --only ball --out bench

    Args:
        parts: Run only this part; may be repeated.
        drawn (SEED): Scenes: a dozen, drawn at random, instead of the table's. Unlike, moving:
            their seed.
        tolerances (5%|1%): Scenes: tolerance that chooses the presets (5%); may be repeated.
        device: Scenes: cpu or cuda:0.
        environments (N): Scenes: size of a batch, instead of one press alone; may be repeated.
            Unlike: number of presses.
        images: Scenes in batches: compute the camera's image, the markers and the surface's stress
            in every frame.
        reference: Scenes: first press with preset reference; --json keeps the result for --against.
        against (FILE): Scenes: reference forces.
    """
    from sim.studies.bench.scenes import Manner
    from sim.studies.bench.study import REFERENCE_FILE, Bench
    from tacauchy_rig.app.replay.rendering import replay_images
    from tacauchy_rig.core.config.load import load_config

    alone = [Manner(tolerance=each, device=device) for each in tolerances or ("5%",)]
    batches = [Manner(device=device, environments=count) for count in environments or ()]
    manners = [replace(each, images=images) for each in batches or alone]
    study = Bench(
        terms=SceneTerms(indenter=indenter, sensor=sensor, depth="1mm", preset=Preset.FAST),
        forces_n=load_config(None).config.protocol.force_targets,
        make_images=replay_images,
        chosen=parts or tuple(Part),
        drawn=drawn,
        manners=manners,
        reference=reference,
        against=against or REFERENCE_FILE,
    )
    how.measure(study)
