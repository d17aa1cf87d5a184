"""``tacauchy-rig study``: the studies that a user runs, and the runner behind all studies."""

from __future__ import annotations

import inspect
import json
import shlex
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any

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


def study_command(make: Callable[..., Study]) -> Callable[..., None]:
    """Return a command of a study: its own options first, then those of every study.

    Args:
        make: Makes the study of its own options; its docstring is the command's help.
    """
    own = inspect.signature(make, eval_str=True).parameters
    shared = inspect.signature(output.documented(_run)).parameters

    def command(context: typer.Context, **given: Any) -> None:
        study = make(**{name: given.pop(name) for name in own})
        _run(study, said_command(context), **given)

    named = inspect.Parameter("context", inspect.Parameter.KEYWORD_ONLY, annotation=typer.Context)
    options = [*own.values(), *list(shared.values())[2:]]
    command.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [named, *(each.replace(kind=inspect.Parameter.KEYWORD_ONLY) for each in options)]
    )
    command.__annotations__ = {each.name: each.annotation for each in (named, *options)}
    command.__name__, command.__doc__ = make.__name__, make.__doc__
    return command


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


def _run(
    study: Study,
    command: str,
    *,
    only: list[str] | None = None,
    list_only: Annotated[bool, typer.Option("--list")] = False,
    jobs: output.Jobs = 1,
    limit: str = "",
    resume: list[Path] | None = None,
    out: Path | None = None,
    json_file: output.JsonFile = None,
) -> None:
    """Measure the selected cases, show tables, and write page, figures and JSON.

    Args:
        only (PATTERN): Select cases by name; `*` matches anything; may be repeated.
        list_only: List the cases and stop.
        limit (TIME): A case that takes longer has failed.
        resume (FILE): JSON of an earlier run, whose results are taken; may be repeated. A case that
            failed there is measured again if --only names it.
        out (FILE.md|DIR): Write a page, its figures beside it in images; into DIR also JSON, and
            figures for print.
    """
    limit_s = parse_quantity(limit, dimension=Dimension.TIME, field="--limit") if limit else None
    if study.is_together and (jobs > 1 or limit_s is not None):
        raise ConfigError(
            f"the {study.kind}s of {study.name} go on from one another",
            remedy="leave out --jobs and --limit",
        )
    if resume and not study.is_resumable:
        raise ConfigError(
            f"{study.name} draws the presses themselves, which JSON does not keep",
            remedy="leave out --resume",
        )
    cases = study.cases()
    chosen = selected(
        cases,
        [study.pattern(text) for text in only or ()],
        names=lambda case: (case.name, *filter(None, (case.alias,))),
        kind=study.kind,
    )
    if not only:
        chosen = tuple(case for case in chosen if list_only or not case.on_request)
    if list_only:
        for case in chosen:
            output.say(f"{case.name:22} {case.shows}".rstrip())
        return
    kept = kept_results(resume or [], chosen)
    if only:
        kept = {name: each for name, each in kept.items() if not each.failure}
    elif out is None:
        out = study.page_file
    _Runner(study, chosen, kept, command, out, json_file).run(jobs, limit_s)


@dataclass(slots=True)
class _Runner:
    study: Study
    cases: Sequence[Case]
    results: dict[str, Result]
    command: str
    out: Path | None
    json_file: Path | None

    def run(self, jobs: int, limit_s: float | None) -> None:
        study, is_cut = self.study, False
        if self.out is not None:
            output.writable_folder(self.out.parent if self._page == self.out else self.out)
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
        for file in self._written(figures=bool(done)):
            output.say(str(file))
        if is_cut:
            raise AbortedError("aborted by Ctrl-C")
        raise typer.Exit(0 if study.has_passed(done) else 1)

    @property
    def _done(self) -> list[Result]:
        """The results that are there, in the order of the cases."""
        return [self.results[case.name] for case in self.cases if case.name in self.results]

    @property
    def _page(self) -> Path | None:
        if self.out is None or self.out.suffix == ".md":
            return self.out
        return self.out / f"{self.study.name}.md"

    def _write(self, images: Sequence[str] = ()) -> None:
        """Write page and JSON of what is there, after every case."""
        done, page = self._done, self._page
        if not done:
            return
        about = About(self.command, commit(), len(self.cases) - len(done))
        if page is not None:
            output.write_text(page, self.study.page(done, about, images))
        facts = {
            **self.study.facts(done),
            "results": done if self.study.is_resumable else [],
            **about._asdict(),
            "machine": machine(),
            "versions": versions(),
        }
        for file in filter(None, (self.json_file, self._own_json)):
            output.write_json(file, facts)

    @property
    def _own_json(self) -> Path | None:
        page = self._page
        return page.with_suffix(".json") if page is not None and page != self.out else None

    def _written(self, *, figures: bool) -> Iterator[Path]:
        """Draw the figures, write the page with them, and yield all files."""
        page = self._page
        if page is None:
            return
        drawn = self._drawn(page) if figures else []
        pictures = [file for file in drawn if file.parent == page.parent / "images"]
        self._write([f"images/{file.name}" for file in pictures])
        yield from (*(file for file in drawn if file.exists()), page)
        if self._own_json:
            yield self._own_json

    def _drawn(self, page: Path) -> list[Path]:
        from matplotlib import rc_context

        from tacauchy_rig.core.plot_style import FRAMED_STYLE, STYLE, save_figure

        with ExitStack() as spare, rc_context(FRAMED_STYLE if self.study.is_framed else STYLE):
            folder = page.parent
            if page == self.out:  # a page alone: figures for print are not asked for
                folder = Path(spare.enter_context(TemporaryDirectory()))
            images = page.parent / "images"
            return [
                file
                for name, figure in self.study.figures(self._done).items()
                for file in save_figure(figure, folder, name, page_folder=images)
            ]


@study_command
def accuracy(
    *,
    sensor: str = "gelsight-mini",
    indenter: str = "cylinder:diameter=5mm,fillet=0.1mm",
    force: str = "4.7332N",
    full: bool = False,
    seed: list[int] | None = None,
    tolerances: bool = False,
) -> Study:
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
    return Accuracy(terms, _similarity, full=full, seeds=seed or (0,), tolerances=tolerances)


def _similarity(exact: ImageArray, found: ImageArray, maps: HeightMaps) -> tuple[float, float]:
    import numpy as np

    from reports.scores.image_metrics import structural_similarity_index, zero_mean_correlation
    from sim.optics.render.renderer import GREY_LEVEL

    inside = maps.contact
    changes = [image.astype(np.float64)[inside] - GREY_LEVEL for image in (exact, found)]
    return structural_similarity_index(exact, found), zero_mean_correlation(*changes)


@study_command
def hard_cases() -> Study:
    """Simulate hard cases, each in its own process.

    Example: tacauchy-rig study hard-cases --only 1 --only 14
    """
    from sim.studies.hard_cases.study import HardCases

    return HardCases()


@study_command
def effects(*, random: int = 0, seed: int = 0, errors: bool = False) -> Study:
    """Press scenes with their planned effects and with all; compare outputs and times.

    A scene has 60 s if --limit is not given; one that takes longer is left, and named.

    Example: tacauchy-rig study effects --only "by force"

    Args:
        random (N): Draw this many scenes instead.
        seed: Seed of the drawn scenes.
        errors: Compare the stated errors with a finer mesh too.
    """
    from sim.studies.effects.study import Effects

    return Effects(count=random, seed=seed, errors=errors)


@study_command
def verify() -> Study:
    """Compare presses with known solutions; takes minutes.

    Example: tacauchy-rig study verify --only punch --only hertz
    """
    from sim.studies.verification import Verification

    return Verification()


@study_command
def modes(
    *, indenter: str = "cylinder:diameter=5mm,fillet=0.5mm", preset: Preset = Preset.FAST
) -> Study:
    """Press, slide and twist on a GelSight Mini; press a ball into three sensors; draw both.

    Example: tacauchy-rig study modes --out modes

    Args:
        indenter: cylinder:diameter=,fillet= or sphere:diameter=
    """
    from sim.studies.modes.study import Modes

    return Modes(indenter, preset)


@study_command
def objects(*, sensors: str = "gelsight-mini,digit", preset: Preset = Preset.FAST) -> Study:
    """Press five objects, from sharp edges to smooth curves, and draw dents and tactile images.

    Example: tacauchy-rig study objects --out objects

    Args:
        sensors: Names or files, with commas between.
    """
    from sim.studies.objects.study import Objects

    return Objects(sensors, preset)


@study_command
def paper(
    *, benchmarks: Path = Path("docs/results/benchmarks"), report: list[Path] | None = None
) -> Study:
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
    return Paper(benchmarks)


@study_command
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
) -> Study:
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
    return Bench(
        terms=SceneTerms(indenter=indenter, sensor=sensor, depth="1mm", preset=Preset.FAST),
        forces_n=load_config(None).config.protocol.force_targets,
        make_images=replay_images,
        chosen=parts or tuple(Part),
        drawn=drawn,
        manners=manners,
        reference=reference,
        against=against or REFERENCE_FILE,
    )
