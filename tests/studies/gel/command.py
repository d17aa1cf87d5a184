"""``python -m tests.studies gel``: does a calibration of a gel hold what it says?"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated

import numpy as np
import typer

from reports.evidence.loading import stated_of_run
from sim.scene.scene import Preset
from sim.sensitivity import forces_at
from tacauchy_rig.app.calibration.material.fit import (
    Response,
    fit_gel,
    gel_of,
    held_count,
    predict_held_out,
)
from tacauchy_rig.app.calibration.material.presses import IndenterPresses
from tacauchy_rig.app.cli.options import Jobs, JsonFile
from tacauchy_rig.app.cli.output import say, show_table, write_json
from tacauchy_rig.app.replay.inputs import inputs_of
from tacauchy_rig.app.replay.uncertainty import variations
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.tables import Table

BALL, PUNCH, WIDE = (
    "sphere:diameter=6mm",
    "cylinder:diameter=4mm,fillet=0.5mm",
    "cylinder:diameter=8mm,fillet=0.5mm",
)
DEPTHS_M = np.array([0.2e-3, 0.35e-3, 0.5e-3, 0.65e-3, 0.8e-3])
NOISE_N = 0.008
HELD_MIN, LEFT_OUT_MIN = 0.8, 0.9
"""Parts of the gels, and of the presses left out, whose interval has to hold what is true."""
SETS = ((BALL,), (PUNCH,), (BALL, PUNCH), (BALL, PUNCH, WIDE))
# As a rig that is set up for it: tool and gel lined up, a good cell.
MEASURED = (
    'uncertainty.tilt="0 deg"',
    'uncertainty.offset="0 mm"',
    'uncertainty.diameter="10 um"',
    'uncertainty.fillet="10 um"',
    'uncertainty.depth="3 um"',
    'uncertainty.force_scale="0.5 %"',
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Gel:
    """A drawn gel."""

    young_pa: float
    poisson: float
    friction: float


def drawn_gel(seed: int) -> Gel:
    """Draw a gel as far off the file as gels may be."""
    random = np.random.default_rng([seed, 1])
    return Gel(
        young_pa=435e3 * float(random.uniform(0.6, 1.6)),
        poisson=float(random.uniform(0.45, 0.485)),
        friction=float(random.uniform(0.1, 0.8)),
    )


def presses_of(
    seed: int, indenter: str, *, preset: Preset = Preset.FAST, press_count: int | None = None
) -> IndenterPresses:
    """Press a drawn gel: the height of the gel is the same under all of a seed's indenters."""
    config = load_config(overrides=(*MEASURED, f'replay.indenter="{indenter}"')).config
    stated, gel = inputs_of(config), drawn_gel(seed)
    shared, own = np.random.default_rng([seed, 2]), np.random.default_rng([seed, len(indenter), 3])
    sensor = stated.sensor.stiffer(gel.young_pa / stated.sensor.material.young_pa)
    inputs = gel_of(replace(stated, sensor=sensor, preset=preset), gel.poisson, gel.friction)
    for name in [each.name for each in variations(inputs, config)]:
        (each,) = (found for found in variations(inputs, config) if found.name == name)
        if name in ("Poisson's ratio", "friction"):
            continue
        random = shared if name.startswith(("gel", "dome")) else own
        inputs = each.changed(each.stated.value * random.standard_normal())
    doubts = stated_of_run(config, None)
    gain = 1.0 + doubts["force_scale"].value * shared.standard_normal()
    count = press_count or len(DEPTHS_M)
    press = np.arange(len(DEPTHS_M)) % count
    low_m = doubts["depth"].value * own.standard_normal(count)[press]
    scene = replace(inputs.scene([1.0]), outputs=frozenset())
    true_n = gain * forces_at(scene, (DEPTHS_M + low_m).tolist())
    return IndenterPresses(
        config=config,
        inputs=stated,
        contact_force_n=0.0,
        press=press,
        depth_m=DEPTHS_M,
        force_n=true_n + NOISE_N * own.standard_normal(len(DEPTHS_M)),
        noise_n=np.full(len(DEPTHS_M), NOISE_N),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Fitted:
    """What a calibration of one gel with some indenters says."""

    indenters: tuple[str, ...]
    # Whether the intervals of modulus, Poisson's ratio and friction hold what is true.
    held: tuple[bool, bool, bool]
    told: tuple[bool, bool, bool]  # whether they are closed
    uncertainty: float | None  # of the modulus, over the true one; None where it is not told
    # Forces of presses left out that lay within their interval, and how many there are.
    left_out: tuple[int, int]


def fitted_gel(
    seed: int,
    presses: Mapping[str, IndenterPresses],
    responses: Mapping[str, Response],
    *,
    sets: Sequence[tuple[str, ...]] = SETS,
) -> Iterator[Fitted]:
    """Calibrate a drawn gel by each set of indenters, from its presses by indenter."""
    gel = drawn_gel(seed)
    for indenters in sets:
        data = [(presses[name], responses[name]) for name in indenters]
        fit = fit_gel(data)
        intervals = fit.young, fit.poisson, fit.friction
        known = zip(intervals, (gel.young_pa, gel.poisson, gel.friction), strict=True)
        young, poisson, friction = (interval.holds(value) for interval, value in known)
        doubt = fit.young.uncertainty
        yield Fitted(
            indenters=indenters,
            held=(young, poisson, friction),
            told=(fit.young.is_bounded, fit.poisson.is_bounded, fit.friction.is_bounded),
            uncertainty=None if doubt is None else doubt / gel.young_pa,
            left_out=held_count(list(predict_held_out(data, fit))),
        )


def gel_table(fitted: Sequence[Fitted]) -> Table:
    """Return a row for each set of indenters: how often what is true lies in its interval."""
    rows, passed = [], bool(fitted)
    for indenters in dict.fromkeys(each.indenters for each in fitted):
        own = [each for each in fitted if each.indenters == indenters]
        held = np.sum([each.held for each in own], axis=0)
        told = np.sum([each.told for each in own], axis=0)
        out, count = np.sum([each.left_out for each in own], axis=0).tolist()
        known = [each.uncertainty for each in own if each.uncertainty is not None]
        passed = passed and bool(np.all(held >= HELD_MIN * len(own)))
        passed = passed and out >= LEFT_OUT_MIN * count
        rows.append(
            (
                ", ".join(indenters),
                f"{', '.join(map(str, held))} of {len(own)}",
                f"{told[1]}, {told[2]}",
                100.0 * math.fsum(known) / len(known) if known else None,
                f"{out} of {count}",
            )
        )
    return Table(
        title="How often a calibration's 95 % intervals hold a drawn gel",
        columns=(
            "indenters",
            "E, nu, mu within their interval",
            "nu, mu told",
            "standard uncertainty of E [%]",
            "left out within theirs",
        ),
        rows=tuple(rows),
        criterion=f"{HELD_MIN:.0%} of the gels, {LEFT_OUT_MIN:.0%} of the presses left out",
        passed=passed,
    )


def gel_check(
    gels: Annotated[int, typer.Option("--gels", min=1, help="How many are drawn.")] = 10,
    seed: Annotated[int, typer.Option("--seed", help="Of the first of them.")] = 1,
    truth: Annotated[Preset, typer.Option("--truth", help="Of the gels.")] = Preset.BALANCED,
    jobs: Jobs = 1,
    json_file: JsonFile = None,
) -> None:
    """Calibrate drawn gels by one indenter and more; count how often the intervals hold them.

    Example: python -m tests.studies gel --gels 10 --jobs 2
    """
    from tacauchy_rig.app.calibration.material.fit import respond
    from tacauchy_rig.core.parallel import parallel_map

    tools, seeds = (BALL, PUNCH, WIDE), range(seed, seed + gels)
    say("pressing with every indenter, nu and friction that a gel may have")
    responses = {tool: respond(presses_of(seed, tool), jobs=jobs) for tool in tools}
    tasks = [(number, tool) for number in seeds for tool in tools]
    presses: dict[int, dict[str, IndenterPresses]] = {}
    work = partial(_pressed, truth=truth)
    for (number, tool), found in parallel_map(work, tasks, jobs=jobs, new_process_each=False):
        say(f"gel {number}: pressed with {tool}")
        presses.setdefault(number, {})[tool] = found
    fitted: list[Fitted] = []
    for number, own in presses.items():
        fitted += fitted_gel(number, own, responses)
    table = gel_table(fitted)
    show_table(table)
    write_json(json_file, {"table": table, "gels": fitted})
    raise typer.Exit(0 if table.passed else 1)


def _pressed(task: tuple[int, str], *, truth: Preset) -> IndenterPresses:

    return presses_of(*task, preset=truth)
