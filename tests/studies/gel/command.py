"""``python -m tests.studies gel``: does a calibration of a gel hold what it says?"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import product
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from scipy.interpolate import PchipInterpolator

from sim.scene.scene import Preset
from sim.sensitivity import forces_at
from tacauchy_rig.app.calibration.material.fit import (
    MU,
    NU,
    YOUNG,
    GelFit,
    Interval,
    Response,
    contradictions,
    gel_of,
    predict_left_out,
    respond,
)
from tacauchy_rig.app.calibration.material.presses import IndenterPresses
from tacauchy_rig.app.cli.output import Jobs, JsonFile, say, show_table, write_json
from tacauchy_rig.app.replay.inputs import inputs_of
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.config.model import RigConfig
from tacauchy_rig.core.parallel import parallel_map
from tacauchy_rig.core.tables import Table

BALL, PUNCH, LARGE = (
    "sphere:diameter=6mm",
    "cylinder:diameter=8mm,fillet=0.5mm",
    "sphere:diameter=14mm",
)
SETS = ((BALL,), (BALL, LARGE), (BALL, PUNCH))
DEPTHS_M = np.array([0.2e-3, 0.3e-3, 0.4e-3, 0.5e-3, 0.65e-3, 0.8e-3])
NOISE_N, ZERO_M, OFF_M, GRAMS = 0.005, 0.02e-3, 0.2e-3, 101.97
HELD_MIN, LEFT_OUT_MIN = 0.92, 0.95
"""Parts of the gels, and of the forces left out, whose interval has to hold what is true."""
FINE = Path(__file__).with_name("fine_presses.json")
"""Force over modulus [m^2] of presses on preset balanced, over depth, by indenter, nu and mu."""
NODES = list(product((0.4, 0.456, 0.495), (0.1, 1.0)))
"""Poisson's ratios and frictions of gels: of none does the fit's surrogate have presses."""
_FINE_DEPTHS_M = 1e-3 * np.array([0.06, 0.12, 0.2, 0.3, 0.45, 0.6, 0.78, 0.98])


@cache
def config_of(indenter: str) -> RigConfig:
    """Return a rig that is set up for it: sizes and place known, a good cell."""
    known = ("tilt", "offset", "diameter", "fillet")
    stated = [f'uncertainty.{name}="0 {"deg" if name == "tilt" else "mm"}"' for name in known]
    stated += [f'uncertainty.depth="{ZERO_M * 1e3} mm"', 'uncertainty.force_scale="0.5 %"']
    return load_config(overrides=(*stated, f'replay.indenter="{indenter}"')).config


@dataclass(frozen=True, slots=True, kw_only=True)
class Gel:
    """A drawn gel."""

    young_pa: float
    poisson: float
    friction: float


def drawn_gel(seed: int) -> Gel:
    """Draw a gel as far off the file as gels may be."""
    random = np.random.default_rng([seed, 1])
    nu, mu = NODES[random.integers(len(NODES))]
    young_pa = 1e6 * float(np.exp(random.uniform(np.log(0.05), 0.0)))
    return Gel(young_pa=young_pa, poisson=nu, friction=mu)


def _name(indenter: str, poisson: float, friction: float) -> str:
    return f"{indenter}, nu {poisson}, mu {friction}"


@cache
def _fine() -> dict[str, list[float]]:
    return dict(json.loads(FINE.read_text("utf-8")))


def true_area_m2(indenter: str, gel: Gel, depth_m: FloatArray) -> FloatArray:
    """Interpolate a fine press between its depths."""
    area = _fine()[_name(indenter, gel.poisson, gel.friction)]
    spline = PchipInterpolator(np.log(_FINE_DEPTHS_M), np.log(area), extrapolate=True)
    return np.asarray(np.exp(spline(np.log(depth_m))))


def presses_of(seed: int, indenter: str) -> IndenterPresses:
    """Press a drawn gel; its cell's gain is the same under all of a seed's indenters."""
    config, gel = config_of(indenter), drawn_gel(seed)
    shared, own = (np.random.default_rng([seed, k]) for k in (2, 3 + len(indenter)))
    gain = 1.0 + 0.005 * shared.standard_normal()
    depth_m = DEPTHS_M + ZERO_M * own.standard_normal()
    force_n = gain * gel.young_pa * true_area_m2(indenter, gel, depth_m)
    return IndenterPresses(
        config=config,
        inputs=inputs_of(config),
        contact_force_n=0.0,
        press=np.zeros(len(DEPTHS_M), dtype=np.int64),
        depth_m=DEPTHS_M,
        force_n=force_n + NOISE_N * own.standard_normal(len(DEPTHS_M)),
        noise_n=np.full(len(DEPTHS_M), NOISE_N),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """What a calibration of one gel with some indenters says."""

    seed: int
    indenters: tuple[str, ...]
    gel: Gel
    told: tuple[Interval, ...]  # of E [Pa], nu and mu
    held: tuple[bool, ...]  # whether they hold what is true
    left_out: tuple[int, int]  # forces left out that lay within their interval, and all
    accused: bool  # the right data were said to contradict their errors
    caught: Mapping[str, bool]  # whether wrong data were, by what is wrong with them


def wrong_data(presses: Sequence[IndenterPresses]) -> Iterator[tuple[str, list[IndenterPresses]]]:
    """Yield what is wrong, and the presses with it."""
    yield "gram-force", [replace(each, force_n=GRAMS * each.force_n) for each in presses]
    yield "zero of depth", [replace(each, depth_m=each.depth_m + OFF_M) for each in presses]
    if len(presses) > 1:
        forces = [each.force_n for each in reversed(presses)]
        swapped = zip(presses, forces, strict=True)
        yield "wrong label", [replace(each, force_n=force) for each, force in swapped]


def judged_gel(task: tuple[int, tuple[str, ...]], *, responses: Mapping[str, Response]) -> Judged:
    """Calibrate a drawn gel with some indenters, from right data and from wrong ones."""
    seed, indenters = task
    gel, own = drawn_gel(seed), [responses[name] for name in indenters]
    presses = [presses_of(seed, name) for name in indenters]
    fit = GelFit(data=list(zip(presses, own, strict=True)))
    told = tuple(fit.interval(place) for place in (YOUNG, NU, MU))
    true = (gel.young_pa, gel.poisson, gel.friction)
    left_out = list(predict_left_out(fit))
    return Judged(
        seed=seed,
        indenters=indenters,
        gel=gel,
        told=told,
        held=tuple(found.holds(value) for found, value in zip(told, true, strict=True)),
        left_out=(sum(each.held for each in left_out), len(left_out)),
        accused=bool(contradictions(fit, left_out)),
        caught={
            name: _is_refused(GelFit(data=list(zip(wrong, own, strict=True))))
            for name, wrong in wrong_data(presses)
        },
    )


def _is_refused(fit: GelFit) -> bool:
    """Return whether the command ends with 1; what is clear at once needs no prediction."""
    return bool(contradictions(fit, ()) or contradictions(fit, list(predict_left_out(fit))))


def gel_table(judged: Sequence[Judged]) -> Table:
    """Return a row for each set of indenters: how often what is true lies in its interval."""
    rows, passed = [], bool(judged)
    for indenters in dict.fromkeys(each.indenters for each in judged):
        own = [each for each in judged if each.indenters == indenters]
        held = np.array([each.held for each in own])
        closed = np.array([[found.is_bounded for found in each.told] for each in own])
        out, count = np.sum([each.left_out for each in own], axis=0).tolist()
        caught = {name: sum(each.caught[name] for each in own) for name in own[0].caught}
        accused = sum(each.accused for each in own)
        right = (held & closed).sum(axis=0)
        passed = passed and bool(
            np.all(right >= HELD_MIN * closed.sum(axis=0))
            and np.all(held.sum(axis=0) >= HELD_MIN * len(own))
            and out >= LEFT_OUT_MIN * count
            and min(caught.values()) == len(own)
            and accused <= (1.0 - HELD_MIN) * len(own)
        )
        rows.append(
            (
                ", ".join(indenters),
                ", ".join(map(str, held.sum(axis=0).tolist())),
                f"{right[0]} of {closed[:, 0].sum()}",
                f"{right[1]} of {closed[:, 1].sum()}",
                f"{right[2]} of {closed[:, 2].sum()}",
                f"{out} of {count}",
                accused,
                ", ".join(f"{name} {found}" for name, found in caught.items()),
            )
        )
    return Table(
        title="How often a calibration's 95 % intervals hold a drawn gel",
        columns=(
            "indenters",
            "E, nu, mu within their interval, open ones too",
            "E: closed ones",
            "nu: closed ones",
            "mu: closed ones",
            "left out within theirs",
            "right data refused",
            "wrong data refused",
        ),
        rows=tuple(rows),
        criterion=f"{HELD_MIN:.0%} of intervals, {LEFT_OUT_MIN:.0%} of forces left out, all wrong "
        "data refused",
        passed=passed,
    )


def _fine_area(task: tuple[str, tuple[float, float]]) -> list[float]:
    indenter, node = task
    inputs = replace(gel_of(inputs_of(config_of(indenter)), *node), preset=Preset.BALANCED)
    scene = replace(inputs.scene([1.0]), outputs=frozenset())
    found = forces_at(scene, _FINE_DEPTHS_M.tolist()) / inputs.sensor.material.young_pa
    return [float(area) for area in found]


def gel_check(
    gels: Annotated[int, typer.Option("--gels", min=1, help="How many are drawn.")] = 100,
    seed: Annotated[int, typer.Option("--seed", help="Of the first of them.")] = 1,
    jobs: Jobs = 1,
    json_file: JsonFile = None,
) -> None:
    """Calibrate drawn gels by one indenter and more; count how often the intervals hold them.

    Example: python -m tests.studies gel --gels 100 --seed 1001 --jobs 2
    """
    tools = (BALL, LARGE, PUNCH)
    lacking = [task for task in product(tools, NODES) if _name(task[0], *task[1]) not in _fine()]
    for (tool, node), area in parallel_map(_fine_area, lacking, jobs=jobs):
        say(f"{_name(tool, *node)}: pressed on preset balanced")
        _fine()[_name(tool, *node)] = area
        FINE.write_text(json.dumps(_fine(), indent=1), "utf-8")
    responses = {}
    for tool in tools:
        say(f"{tool}: solving with every nu and friction that a gel may have")
        responses[tool] = respond(presses_of(seed, tool), jobs=jobs)
    tasks = list(product(range(seed, seed + gels), SETS))
    work = partial(judged_gel, responses=responses)
    judged = []
    for _, found in parallel_map(work, tasks, jobs=jobs, new_process_each=False):
        judged.append(found)
        if not all(found.held):
            say(f"gel {found.seed}, {', '.join(found.indenters)}: {found.gel}, {found.told}")
    table = gel_table(judged)
    show_table(table)
    write_json(json_file, {"table": table, "gels": judged})
    raise typer.Exit(0 if table.passed else 1)
