"""Study "mounting": what simulating friction and tilt gains, and how well a tilt is found."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from scipy.optimize import brentq

from drivers.emulators.force_sensor.m8128_box_and_noise import ForceChannel
from drivers.emulators.plant.gel_response import Plant
from drivers.emulators.plant.truth import CylinderTip, draw_truth
from reports.comparison.run_comparison import compare
from sim.scene.scene import Preset
from tacauchy_rig import __version__
from tacauchy_rig.app.cli.emulated_calibration import emulated_unit
from tacauchy_rig.app.cli.output import Found, say, show_table, write_text
from tacauchy_rig.app.replay.simulator_inputs import inputs_of
from tacauchy_rig.app.replay.tilt_and_place import TAKEN_FROM, Dwell, tilt_of
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.run import FZ, Outcome, Pose, TrialRecord
from tacauchy_rig.core.tables import Table, table_of
from tacauchy_rig.core.time_limit_and_progress import heard
from tests.studies.verdict.bench import Bench

_LARGEST_RAD = math.radians(2.0)
_CLEAR_RAD = math.radians(0.5)  # from here on what is found is set over what is true
_COVERED = 0.9
"""Of the tools whose lean lies within twice its stated uncertainty: 95 in 100, less chance."""
_SETTLED_NS = 15 * 10**9  # the gel has relaxed by then
_DEEPEST_M = 0.95e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnTool:
    """True lean, and what was found with which standard uncertainty, along x and y [rad]."""

    seed: int
    true_rad: tuple[float, float]
    found_rad: tuple[float, float]
    uncertainty_rad: tuple[float, float]

    @property
    def off(self) -> float:
        """Of both, the larger error over its uncertainty."""
        rows = zip(self.true_rad, self.found_rad, self.uncertainty_rad, strict=True)
        return max(abs(found - true) / doubt for true, found, doubt in rows)


def find_drawn(seeds: Iterable[int], config: RigConfig) -> list[DrawnTool]:
    """Press with a drawn tool in each world, and find its lean from the cell's moments."""
    inputs, found = inputs_of(config), []
    for seed in seeds:
        random = np.random.default_rng([seed, 5])
        size, way = _LARGEST_RAD * random.random(), 2.0 * np.pi * random.random()
        true = (float(size * np.cos(way)), float(size * np.sin(way)))
        fit, why = tilt_of(drawn_dwells(seed, true, config), inputs, config)
        if fit is None:
            say(f"seed {seed}: {why}")
            continue
        x, y = fit.tilt_rad.tolist()
        doubt_x, doubt_y = fit.uncertainty_rad.tolist()
        tool = DrawnTool(
            seed=seed, true_rad=true, found_rad=(x, y), uncertainty_rad=(doubt_x, doubt_y)
        )
        say(f"seed {seed}: off by {tool.off:.2f} uncertainties")
        found.append(tool)
    return found


def tilt_table(tools: Sequence[DrawnTool]) -> Table:
    """Return a row for each tool."""
    within = sum(tool.off <= TAKEN_FROM for tool in tools)
    return table_of(
        tools,
        {
            "seed": lambda t: t.seed,
            "true x, y [deg]": lambda t: _pair(t.true_rad),
            "found x, y [deg]": lambda t: _pair(t.found_rad),
            "uncertainty [deg]": lambda t: _pair(t.uncertainty_rad),
            "error over uncertainty": lambda t: t.off,
        },
        title="The lean of drawn tools, from moments",
        criterion=f"at least {_COVERED:.0%} are within {TAKEN_FROM:g} standard uncertainties",
        passed=bool(tools) and within >= _COVERED * len(tools),
    )


def tilt_ratio(tools: Sequence[DrawnTool]) -> str:
    """Return how much of a clear lean is found, in words."""
    ratios = [
        float(np.dot(tool.found_rad, tool.true_rad) / np.dot(tool.true_rad, tool.true_rad))
        for tool in tools
        if math.hypot(*tool.true_rad) >= _CLEAR_RAD
    ]
    if not ratios:
        return "none"
    return f"{np.mean(ratios):.2f} in the mean, {min(ratios):.2f} to {max(ratios):.2f}"


def drawn_dwells(seed: int, tilt_rad: tuple[float, float], config: RigConfig) -> list[Dwell]:
    """Return the held presses of a world as its cell reads them."""
    inputs, emulated = inputs_of(config), config.emulation
    truth = draw_truth(
        seed, unit=emulated_unit(inputs.sensor), friction=emulated.friction, tilt_rad=tilt_rad
    )
    tip = CylinderTip(diameter_m=config.indenter.diameter, fillet_m=config.indenter.fillet)
    plant = Plant(truth, tip, config.sensor.surface)
    touched_m = _depth_at(plant, config.protocol.contact_force)
    sign = config.force_sensor.compression_sign
    channel = ForceChannel(truth, start_ns=0, compression_sign=sign)
    return [
        _dwell(index, Plant(truth, tip, config.sensor.surface), channel, force_n, touched_m, config)
        for index, force_n in enumerate(config.protocol.force_targets, start=1)
    ]


def _depth_at(plant: Plant, force_n: float) -> float:
    return float(brentq(lambda d: plant.relaxed(d)[0] - force_n, -1e-4, _DEEPEST_M))


def _dwell(
    index: int,
    plant: Plant,
    channel: ForceChannel,
    force_n: float,
    touched_m: float,
    config: RigConfig,
) -> Dwell:
    rotation, depth_m = config.robot.tool_rotation, _depth_at(plant, force_n)
    sign, rate = config.force_sensor.compression_sign, config.force_sensor.rate

    def read(height_m: float, stamp_ns: int, duration_s: float) -> np.ndarray:
        """Read the cell with the tip so high above the gel under it [m]."""
        x, y, _ = config.sensor.surface
        pose = Pose(position=(x, y, 0.0), rotation_vector=rotation)
        pose = pose.shifted(z=plant.depth(pose) + height_m)
        plant.wrench(pose, stamp_ns)
        force, torque = plant.wrench(pose, stamp_ns + _SETTLED_NS)
        count = round(duration_s * rate)
        return np.array([channel.reading(force, torque, rotation, stamp_ns) for _ in range(count)])

    idle = read(1e-3, 0, config.protocol.tare_duration)
    held = read(-depth_m, 2 * _SETTLED_NS, config.protocol.dwell_duration)
    mean = held.mean(axis=0) - idle.mean(axis=0)
    error = np.sqrt(held.var(axis=0, ddof=1) / len(held) + idle.var(axis=0, ddof=1) / len(idle))
    record = TrialRecord(
        index=index,
        attempt=1,
        outcome=Outcome.PASSED,
        force_target_n=force_n,
        force_measured_n=sign * float(mean[FZ]),
        depth_measured_m=depth_m - touched_m,
    )
    return record, (mean, error)


def _pair(angles_rad: tuple[float, float]) -> str:
    return ", ".join(f"{math.degrees(angle):.3f}" for angle in angles_rad)


FOUND, UPRIGHT, SMOOTH = "as found", "upright", "upright, no friction"
BEATEN_SHARE = 5.0 / 6.0
"""Of the trials that have to come out better, so that noise in one does not decide."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Residuals:
    """Of one trial: what of the contact's change each replay leaves unexplained [1]."""

    trial: int
    force_n: float
    left: dict[str, float | None]  # by the replay's name; None where the image shows no contact

    @property
    def is_better(self) -> bool:
        """Friction and lean as found leave less than neither."""
        found, smooth = self.left[FOUND], self.left[SMOOTH]
        return found is not None and smooth is not None and found < smooth


def residuals_of(bench: Bench) -> list[Residuals]:
    """Replay a run as found, upright, and upright without friction, each with its own modulus."""
    inputs = bench.inputs
    pressed = {FOUND: bench.pressed}
    for name, other in ((UPRIGHT, inputs.upright), (SMOOTH, replace(inputs.upright, friction=0.0))):
        say(f"replaying {name}")
        pressed[name] = bench.press(other)
    judged = {name: compare(bench.evidence(each)).trials for name, each in pressed.items()}
    return [
        Residuals(
            trial=trial.index,
            force_n=trial.force_measured_n or 0.0,
            left={
                name: contact.relative_residual if (contact := trials[k].contact) else None
                for name, trials in judged.items()
            },
        )
        for k, trial in enumerate(judged[FOUND])
    ]


def residual_table(found: list[Residuals]) -> Table:
    """Return a row for each trial."""
    better = sum(each.is_better for each in found)
    names = (FOUND, UPRIGHT, SMOOTH)
    return Table(
        title="Contact residual with and without",
        columns=("trial", "force [N]", *names, "better"),
        rows=tuple(
            (each.trial, each.force_n, *(each.left[name] for name in names), each.is_better)
            for each in found
        ),
        criterion="friction and lean as found leave less of the contact unexplained than neither, "
        "in five of six trials",
        passed=bool(found) and better >= BEATEN_SHARE * len(found),
    )


def mounting_check(
    folder: Annotated[
        Path,
        typer.Argument(metavar="RUN", help="A recorded dry run.", exists=True, file_okay=False),
    ],
    preset: Annotated[Preset, typer.Option("--preset", help="Of the replays.")] = Preset.BALANCED,
    drawn: Annotated[int, typer.Option("--drawn", help="Worlds whose lean is found.")] = 20,
    seed: Annotated[int, typer.Option("--seed", help="Of the first of them.")] = 1,
    out: Annotated[Path, typer.Option("--out", help="The page.")] = Path(
        "docs/results/mounting_check.md"
    ),
) -> Found:
    """Replay a run with friction and lean and without, and find the lean of drawn tools.

    Example: python -m tests.studies mounting runs/20261123-dry-run
    """
    from tacauchy_rig.app.cli.emulated_calibration import emulated_calibration
    from tacauchy_rig.app.replay.open_run import open_run
    from tacauchy_rig.core.markdown_page import page
    from tests.studies.verdict.bench import bench_of

    run = open_run(folder)
    config = run.store.config
    tools = find_drawn(range(seed, seed + drawn), config)
    calibrate = emulated_calibration(run.store)
    with heard(say):
        bench = bench_of(run, preset=preset, calibrate=calibrate)
    residuals, leans = residual_table(residuals_of(bench)), tilt_table(tools)
    for table in (residuals, leans):
        show_table(table)
    lean = ", ".join(f"{math.degrees(angle):.2f} deg" for angle in bench.inputs.tilt_rad)
    true = [f'"{math.degrees(angle):g} deg"' for angle in config.emulation.tilt or ()]
    tilt = f" --set 'emulation.tilt=[{', '.join(true)}]'" if true else ""
    facts = {
        "command": f"python -m tests.studies mounting RUN --drawn {drawn} --seed {seed}",
        "version": __version__,
        "settings": f"--set emulation.seed={config.emulation.seed}{tilt}",
        "preset": preset.value,
        "residuals": residuals,
        "lean": f"{lean} towards x and y",
        "drawn": leans,
        "drawn_count": drawn,
        "seed": seed,
        "ratio": tilt_ratio(tools),
    }
    write_text(out, page("tests.studies.verdict", "mounting_check.md.jinja", facts))
    say(f"page {out}")
    return Found({"residuals": residuals, "leans": leans}, passed=residuals.passed and leans.passed)
