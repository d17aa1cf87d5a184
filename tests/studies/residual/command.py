"""Study "residual": whether a planted error is named as the cause of the image residual."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from reports.evidence.frames_and_curves import RunReading
from reports.scores.residual_causes import UNMENDABLE, Cause
from sim.optics.colour.photometric import PhotometricModel
from sim.replay import replay_forces
from sim.scene.scene import Preset
from tacauchy_rig import __version__
from tacauchy_rig.app.cli.output import Found, Jobs, say, show_table, write_text
from tacauchy_rig.app.replay.chosen_optics import OpticalCalibration
from tacauchy_rig.app.replay.simulator_inputs import ReplayInputs, measured_attempts
from tacauchy_rig.app.replay.uncertain_inputs import split_images
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.simulated import REPLAY_NAME, ResidualSplit
from tacauchy_rig.core.study import selected
from tacauchy_rig.core.tables import Table, table_of
from tacauchy_rig.core.time_limit_and_progress import heard
from tests.studies.verdict.bench import Bench, Pressed, rendered

_LEAN_RAD, _OFFSET_M, _DIMMED, _STIFFER = math.radians(1.0), 0.3e-3, 0.2, 0.15
_ZERO_N, _SCATTER = 0.3, 0.12
MOST = 0.5  # part of the replays whose planted cause has to come first at least, exclusive


@dataclass(frozen=True, slots=True, kw_only=True)
class Believed:
    """What a wrong replay takes for true."""

    run: RunReading
    inputs: ReplayInputs
    optics: OpticalCalibration


Plant = Callable[[Believed, np.random.Generator], tuple[Believed, str]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ranked:
    """What was planted in a run, and what its split makes of it."""

    run: str
    cause: Cause
    planted: str
    split: ResidualSplit

    @property
    def ranking(self) -> list[Cause]:
        """The causes that can be mended, the largest first."""
        return [Cause(name) for name in self.split.shares if Cause(name) not in UNMENDABLE]

    @property
    def is_first(self) -> bool:
        """Whether what was planted comes first."""
        return self.ranking[0] is self.cause


def _lean(true: Believed, random: np.random.Generator) -> tuple[Believed, str]:
    x, y, degrees = _direction(random)
    told = f"1 deg towards {degrees:.0f} deg"
    return replace(true, inputs=true.inputs.tilted(_LEAN_RAD * x, _LEAN_RAD * y)), told


def _aside(true: Believed, random: np.random.Generator) -> tuple[Believed, str]:
    x, y, degrees = _direction(random)
    beside = true.inputs.moved((_OFFSET_M * x, _OFFSET_M * y))
    return replace(true, inputs=beside), f"0.3 mm towards {degrees:.0f} deg"


def _light(true: Believed, random: np.random.Generator) -> tuple[Believed, str]:
    """Let the lamps have become brighter or darker since the calibration."""
    model, by = true.optics.model, _sign(random) * _DIMMED
    if not isinstance(model, PhotometricModel):
        raise ConfigError("only calibrated lamps grow dim", remedy="take another sensor")
    before = 1.0 / (1.0 + by)
    other = replace(
        model,
        coefficients=model.coefficients * before,
        term_coefficients=model.term_coefficients * before,
    )
    return replace(true, optics=replace(true.optics, model=other)), f"{by:+.0%}"


def _stiffer(true: Believed, random: np.random.Generator) -> tuple[Believed, str]:
    by = _sign(random) * _STIFFER
    sensor = true.inputs.sensor.stiffer(1.0 + by)
    return replace(true, inputs=replace(true.inputs, sensor=sensor)), f"modulus {by:+.0%}"


def _misread(true: Believed, random: np.random.Generator) -> tuple[Believed, str]:
    """Let the cell's zero be off in all trials alike, or each force by itself."""
    run, by_n = RunReading(true.run.store, true.run.geometry), _sign(random) * _ZERO_N
    alike = bool(random.integers(2))
    for index, record in run.records.items():
        if record is not None and record.force_measured_n is not None:
            off_n = by_n if alike else _SCATTER * random.standard_normal() * record.force_measured_n
            run.records[index] = replace(record, force_measured_n=record.force_measured_n + off_n)
    told = f"zero {by_n:+.1f} N" if alike else f"each force off, {_SCATTER:.0%} rms"
    return replace(true, run=run), told


PLANTS: dict[Cause, Plant] = {
    Cause.TILT: _lean,
    Cause.LIGHT: _light,
    Cause.MATERIAL: _stiffer,
    Cause.POSE: _aside,
    Cause.FORCE: _misread,
}


def split_planted(bench: Bench, cause: Cause | None, *, seed: int) -> Ranked | None:
    """Replay a run with one thing wrong, or nothing, and split its residual.

    The modulus is the true replay's: a run whose depths tell it mends a wrong one before any image
    is looked at.
    """
    sensor = bench.inputs.sensor.stiffer(bench.modulus_factor)
    believed = Believed(
        run=bench.run, inputs=replace(bench.inputs, sensor=sensor), optics=bench.optics
    )
    planted = "nothing"
    if cause is not None:
        random = np.random.default_rng([seed, list(PLANTS).index(cause)])
        believed, planted = PLANTS[cause](believed, random)
    part = believed.inputs, measured_attempts(believed.run)
    split = split_images([part], _images(believed), {}, believed.optics, bench.run.store.config)
    if split is None:
        return None
    name = f"seed {bench.run.store.description.get('seed')}"
    return Ranked(run=name, cause=cause or Cause.REST, planted=planted, split=split)


def _images(believed: Believed) -> dict[int, ImageArray]:
    records = [attempt.record for attempt in measured_attempts(believed.run)]
    forces_n = [record.force_measured_n or 0.0 for record in records]
    scene = believed.inputs.scene(forces_n)
    replay, fields = replay_forces(scene, forces_n, name=REPLAY_NAME)
    trials = tuple(
        replace(trial, index=record.index)
        for trial, record in zip(replay.trials, records, strict=True)
    )
    by_trial = {record.index: found for record, found in zip(records, fields, strict=True)}
    pressed = Pressed(replace(replay, trials=trials), by_trial)
    return rendered(believed.run, believed.inputs, pressed, believed.optics)[1]


def planted_table(found: Sequence[Ranked]) -> Table:
    """Return a row for each replay: shares of the causes, and whether the planted one is first."""
    judged = [each for each in found if each.cause is not Cause.REST]
    missed = [f"{r.run}, {r.planted} ({r.ranking[0].value})" for r in judged if not r.is_first]
    first = len(judged) - len(missed)
    residuals = {
        "run": lambda r: r.run,
        "cause": lambda r: "none" if r.cause is Cause.REST else r.cause.value,
        "planted": lambda r: r.planted,
    }
    shares = {
        f"{cause.value} [%]": lambda r, c=cause: round(100.0 * r.split.shares[c.value], 1)
        for cause in Cause
    }
    ranked = {"first": lambda r: r.ranking[0].value}
    return table_of(
        found,
        {**residuals, **shares, **ranked},
        title="What was planted, and what the split says",
        criterion="what was planted comes first of all causes but noise and rest in most replays",
        passed=bool(judged) and first > MOST * len(judged),
        note=f"first in {first} of {len(judged)}; missed: {'; '.join(missed) or 'none'}",
    )


def _direction(random: np.random.Generator) -> tuple[float, float, float]:
    angle = float(random.uniform(0.0, 2.0 * math.pi))
    return math.cos(angle), math.sin(angle), math.degrees(angle)


def _sign(random: np.random.Generator) -> float:
    return 1.0 if random.integers(2) else -1.0


def residual_check(
    folders: Annotated[
        list[Path],
        typer.Argument(metavar="RUN...", help="Recorded dry runs.", exists=True, file_okay=False),
    ],
    preset: Annotated[Preset, typer.Option("--preset", help="Of the replays.")] = Preset.FAST,
    draws: Annotated[int, typer.Option("--draws", min=1, help="Of each cause and run.")] = 3,
    seed: Annotated[int, typer.Option("--seed", help="Of the first draw.")] = 1,
    only: Annotated[
        list[str] | None, typer.Option("--only", help="Causes, such as 'li*'; may be repeated.")
    ] = None,
    out: Annotated[Path, typer.Option("--out", help="The page.")] = Path(
        "docs/results/residual_check.md"
    ),
    jobs: Jobs = 1,
) -> Found:
    """Replay runs with one known thing wrong, and see whether the split ranks it first.

    Example: python -m tests.studies residual runs/20261123-dry-run
    """
    from tacauchy_rig.app.cli.emulated_calibration import emulated_calibration
    from tacauchy_rig.app.replay.open_run import open_run
    from tacauchy_rig.core.markdown_page import page
    from tacauchy_rig.core.parallel import parallel_map
    from tests.studies.verdict.bench import bench_of

    causes = selected(list(PLANTS), only or [], names=lambda cause: (cause.value,), kind="cause")
    found: list[Ranked] = []
    for folder in folders:
        run = open_run(folder)
        calibrate = emulated_calibration(run.store)
        with heard(say):
            bench = bench_of(run, preset=preset, calibrate=calibrate)
        tasks: list[tuple[Cause | None, int]] = [(None, seed)]
        tasks += [(cause, seed + k) for k in range(draws) for cause in causes]
        done = parallel_map(partial(_looked, bench=bench), tasks, jobs=jobs)
        found += [ranked for _, ranked in done if ranked is not None]
    table = planted_table(found)
    show_table(table)
    facts = {
        "command": f"python -m tests.studies residual {' '.join(['RUN'] * len(folders))} "
        f"--preset {preset.value} --draws {draws} --seed {seed}",
        "version": __version__,
        "table": table,
    }
    write_text(out, page("tests.studies.verdict", "residual_check.md.jinja", facts))
    say(f"page {out}")
    return Found({"planted": table}, passed=table.passed)


def _looked(task: tuple[Cause | None, int], *, bench: Bench) -> Ranked | None:
    """Split one replay, and say at once what was found."""
    with heard(say):
        ranked = split_planted(bench, task[0], seed=task[1])
    if ranked is not None:
        shares = ", ".join(f"{name} {share:.0%}" for name, share in ranked.split.shares.items())
        say(f"{ranked.run}, {ranked.planted}: {shares}")
    return ranked
