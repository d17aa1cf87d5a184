"""``python -m tests.studies gel``: does a calibration of a gel hold what it says?

The gels are those of the emulator: another law, a disc, another solver than the fit's.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Annotated, Any

import numpy as np
import typer
from scipy.stats.qmc import LatinHypercube

from drivers.emulators.plant.press_table import PressCase, PressTable, press_table
from drivers.emulators.plant.truth import CylinderTip, SphereTip, Tip
from sim.scene.indenter import Cylinder, Sphere
from sim.scene.scene_parsing import parse_indenter
from tacauchy_rig.app.calibration.material.fit_and_next_presses import (
    MU,
    NORMAL,
    NU,
    YOUNG,
    GelFit,
    Interval,
    Response,
    contradictions,
    gel_to_write,
    predict_left_out,
    respond,
)
from tacauchy_rig.app.calibration.material.measured_presses import IndenterPresses
from tacauchy_rig.app.cli.studies import StudyRun
from tacauchy_rig.app.replay.simulator_inputs import inputs_of
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.config.settings import RigConfig, stated_uncertainty
from tacauchy_rig.core.study import Case, Result, Study, failures_table, founds
from tacauchy_rig.core.tables import Cell, Table, table_of_rows

BALL, PUNCH, LARGE = (
    "sphere:diameter=6mm",
    "cylinder:diameter=8mm,fillet=0.5mm",
    "sphere:diameter=14mm",
)
SETS = {" and ".join(tools): tools for tools in ((BALL,), (BALL, LARGE), (BALL, PUNCH))}
DEPTHS_M = 1e-3 * np.array([0.2, 0.3, 0.4, 0.5, 0.65, 0.8])
NEW_DEPTHS_M, LATER = 1e-3 * np.array([0.25, 0.45, 0.75]), 10
"""Of later presses, which the written file is to predict, and their number for each indenter: most
of what is stated of a force is the zero of depth of its press, so that one press tells little."""
SERIES = 4
"""Of one indenter, or as many of several in all, whose forces are left out. Those of a series miss
together: one of each gel tells the part of 100 gels to 0.8 % only, and four to 0.4 %."""
NOISE_N, ZERO_M, OFF_M, GRAMS, GAIN = 0.005, 0.02e-3, 0.2e-3, 101.97, 0.005
HELD_MIN, LEFT_OUT_MIN = 0.92, 0.95
"""Parts of the gels, and of the forces left out, whose interval has to hold what is true."""
NODES, LOW, HIGH = 6, (0.40, 0.05), (0.49, 1.0)
"""Pairs of nu and mu that the gels of a seed have, and between what they are drawn."""

Gel = tuple[float, float, float]
"""E [Pa], nu and mu."""


@cache
def config_of(indenter: str) -> RigConfig:
    """Return a rig that is set up for it: sizes and place known, a good cell."""
    known = ("tilt", "offset", "diameter", "fillet")
    stated = [f'uncertainty.{name}="0 {"deg" if name == "tilt" else "mm"}"' for name in known]
    stated += [f'uncertainty.depth="{ZERO_M * 1e3} mm"', f"uncertainty.force_scale={GAIN}"]
    return load_config(overrides=(*stated, f'replay.indenter="{indenter}"')).config


def drawn_gel(seed: int, number: int) -> Gel:
    """Draw E [Pa], nu and mu of a gel as far off the file as gels may be."""
    pairs = LatinHypercube(2, seed=seed).random(NODES) * np.subtract(HIGH, LOW) + LOW
    random = np.random.default_rng([seed, number, 1])
    nu, mu = np.round(pairs[random.integers(NODES)], 4).tolist()
    return 1e6 * float(np.exp(random.uniform(np.log(0.05), 0.0))), nu, mu


@cache
def true_press(indenter: str, poisson: float, friction: float) -> PressTable:
    """Press the emulator's gel, or take it from the machine's cache."""
    body = parse_indenter(indenter)
    assert isinstance(body, Cylinder | Sphere)
    tip: Tip = SphereTip(diameter_m=body.diameter_m)
    if isinstance(body, Cylinder):
        tip = CylinderTip(diameter_m=body.diameter_m, fillet_m=body.fillet_m)
    return press_table(PressCase(tip=tip, poisson=poisson, friction=friction))


def true_areas(indenter: str, gel: Gel, depth_m: FloatArray = DEPTHS_M) -> FloatArray:
    """Return the emulator's force over modulus [m^2]."""
    table = true_press(indenter, *gel[1:])
    return np.array([table.at(depth)[0] for depth in depth_m.tolist()])


def measured(indenter: str, depth_m: FloatArray, force_n: FloatArray) -> IndenterPresses:
    """Return one series of forces at depths."""
    config = config_of(indenter)
    return IndenterPresses(
        config=config,
        inputs=inputs_of(config),
        contact_force_n=0.0,
        press=np.zeros(len(depth_m), dtype=np.int64),
        depth_m=depth_m,
        force_n=force_n,
        noise_n=np.full(len(depth_m), NOISE_N),
    )


def presses_of(
    seed: int, number: int, indenter: str, depth_m: FloatArray = DEPTHS_M, series: int = 0
) -> IndenterPresses:
    """Press a drawn gel; its cell's gain is the same in all series."""
    gel = drawn_gel(seed, number)
    gain = 1.0 + GAIN * np.random.default_rng([seed, number, 2]).standard_normal()
    random = np.random.default_rng([seed, number, 3 + series, len(indenter)])
    true_m = depth_m + ZERO_M * random.standard_normal()
    force_n = gain * gel[0] * true_areas(indenter, gel, true_m)
    return measured(indenter, depth_m, force_n + NOISE_N * random.standard_normal(len(depth_m)))


@cache
def response_of(indenter: str) -> Response:
    """Return what the fit takes a gel's forces for, as deep as wrong depths go."""
    return respond(measured(indenter, DEPTHS_M + OFF_M, DEPTHS_M))


def wrong_data(presses: Sequence[IndenterPresses]) -> Iterator[tuple[str, list[IndenterPresses]]]:
    """Yield what is wrong, and the presses with it."""
    yield "gram-force", [replace(each, force_n=GRAMS * each.force_n) for each in presses]
    yield "zero +0.2 mm", [replace(each, depth_m=each.depth_m + OFF_M) for each in presses]
    yield (
        "zero -0.2 mm",
        [measured(each.name, each.depth_m[1:] - OFF_M, each.force_n[1:]) for each in presses],
    )
    if len(presses) > 1:
        forces = [each.force_n for each in reversed(presses)]
        swapped = zip(presses, forces, strict=True)
        yield "wrong label", [replace(each, force_n=force) for each, force in swapped]


def judged_gel(seed: int, number: int, indenters: Sequence[str]) -> dict[str, Any]:
    """Calibrate a drawn gel with some indenters, from right data and from wrong ones."""
    gel, own = drawn_gel(seed, number), [response_of(name) for name in indenters]
    count = SERIES // len(indenters)
    fit, *more = (_fit_of(seed, number, indenters, (LATER + 1) * k) for k in range(count))
    presses = [each for each, _ in fit.data]
    told = [fit.interval(place) for place in (YOUNG, NU, MU)]
    left_out = list(predict_left_out(fit))
    others = [each for again in more for each in predict_left_out(again)]
    return {
        "gel": gel,
        "law": [
            each - 1.0
            for name, response in zip(indenters, own, strict=True)
            for each in (response.area_m2(*gel[1:], DEPTHS_M) / true_areas(name, gel)).tolist()
        ],
        "told": [(found.low, found.best, found.high) for found in told],
        "held": [found.holds(value) for found, value in zip(told, gel, strict=True)],
        "closed": [found.uncertainty is not None for found in told],
        "left_out": [each.off for each in (*left_out, *others)],
        "written": _off_written(seed, number, fit, told),
        "accused": contradictions(fit, left_out),
        "caught": {
            name: _is_refused(GelFit(data=list(zip(wrong, own, strict=True))))
            for name, wrong in wrong_data(presses)
        },
    }


def _fit_of(seed: int, number: int, indenters: Sequence[str], series: int) -> GelFit:
    """Fit a drawn gel to one series of each indenter."""
    presses = (presses_of(seed, number, name, series=series) for name in indenters)
    return GelFit(data=[(each, response_of(each.name)) for each in presses])


def _off_written(seed: int, number: int, fit: GelFit, told: Sequence[Interval]) -> list[float]:
    """Return how far later presses are off what the written file predicts, over what it states.

    That are the uncertainties of E and nu in the file, of mu, of the press's zero of depth and gain
    and of the interpolation, and the force's noise.
    """
    file, young, nu = gel_to_write(fit, told)
    rubbing = told[MU].uncertainty or stated_uncertainty(fit.data[0][0].config, "friction").value
    ratio = nu.uncertainty or file.priors[NU][1]
    doubts, off = [(young.uncertainty or 0.0) / young.best, ratio, rubbing, 1.0], list[float]()
    for presses, response in fit.data:
        drawn = partial(presses_of, seed, number, presses.name, NEW_DEPTHS_M)
        later = [drawn(series=k) for k in range(1, 1 + LATER)]
        new, values = GelFit(data=[(later[0], response)]), np.append(file.best[: MU + 1], 0.0)
        force, gain = new.forces(values), np.hypot(GAIN, np.hypot(*response.uncertain))
        errors = [new.slopes(values) * doubts, np.stack([gain * force, later[0].noise_n], axis=1)]
        total_n = np.linalg.norm(np.hstack(errors), axis=1)
        off += np.ravel([(each.force_n - force) / total_n for each in later]).tolist()
    return off


def _is_refused(fit: GelFit) -> bool:
    """Return whether the command ends with 1; what is clear at once needs no prediction."""
    return bool(contradictions(fit, ()) or contradictions(fit, list(predict_left_out(fit))))


class GelStudy(Study):
    """Calibrations of drawn gels."""

    name, title, kind = "gel", "How often a calibration's 95 % intervals hold a drawn gel", "gel"

    def __init__(self, gels: int, seed: int) -> None:
        self.gels, self.seed = gels, seed

    def cases(self) -> Sequence[Case]:
        """Return every gel under every set of indenters."""
        return [
            Case(
                name=f"{number}: {name}",
                shows=f"seed {self.seed}",
                measure=partial(judged_gel, self.seed, number, tools),
                process=f"{number // 10}",
            )
            for number in range(self.gels)
            for name, tools in SETS.items()
        ]

    def line(self, result: Result) -> str:
        """Return what is missed."""
        if all(result.found["held"]) and not result.found["accused"]:
            return super().line(result)
        return f"{result.found['gel']}, {result.found['told']}, {result.found['accused']}"

    def tables(self, results: Sequence[Result]) -> list[Table]:
        """Return a row for each set of indenters."""
        known: dict[tuple[str, ...], list[Any]] = {
            tools: own
            for name, tools in SETS.items()
            if (own := founds([each for each in results if each.name.endswith(f": {name}")]))
        }
        return [*([gel_table(known)] if known else []), *failures_table(results, kind=self.kind)]


def gel_table(judged: Mapping[tuple[str, ...], Sequence[Mapping[str, Any]]]) -> Table:
    """Return a row for each set of indenters, at least one: how often its intervals hold."""
    rows, passed = list[dict[str, Cell]](), True
    for indenters, own in judged.items():
        held, closed = (np.array([each[key] for each in own]) for key in ("held", "closed"))
        left_out, written = (
            np.abs(np.concatenate([each[key] for each in own])) <= NORMAL
            for key in ("left_out", "written")
        )
        caught = {name: sum(each["caught"][name] for each in own) for name in own[0]["caught"]}
        accused = sum(bool(each["accused"]) for each in own)
        right = (held & closed).sum(axis=0)
        passed = passed and bool(
            np.all(right >= HELD_MIN * closed.sum(axis=0))
            and min(left_out.mean(), written.mean()) >= LEFT_OUT_MIN
            and min(caught.values()) == len(own)
            and accused <= (1.0 - HELD_MIN) * len(own)
        )
        shown = []
        for k in range(3):
            bounded = [each["told"][k] for each in own if each["closed"][k]]
            width = [(high - low) / (1.0 if k else best) for low, best, high in bounded]
            shown.append(f"{right[k]} of {len(width)}; {np.median(width):.2g}" if width else "-")
        young, poisson, friction = shown
        laws = np.quantile([each["law"] for each in own], (0.0, 1.0))
        rows.append(
            {
                "indenters": ", ".join(indenters),
                "E held where determined; median width over E": young,
                "nu; width": poisson,
                "mu; width": friction,
                "fit's force against the emulator's": "{:+.1%} to {:+.1%}".format(*laws),
                "left out within theirs": f"{left_out.sum()} of {left_out.size}",
                "later presses within the written file's": f"{written.sum()} of {written.size}",
                "right data refused": accused,
                "wrong data refused": ", ".join(f"{name} {n}" for name, n in caught.items()),
            }
        )
    return table_of_rows(
        rows,
        title="How often a calibration's 95 % intervals hold a drawn gel",
        criterion=f"{HELD_MIN:.0%} of intervals, {LEFT_OUT_MIN:.0%} of forces left out and later, "
        "all wrong data refused",
        passed=passed,
    )


def gel_check(
    *,
    gels: Annotated[int, typer.Option("--gels", min=1, help="How many are drawn.")] = 100,
    seed: Annotated[int, typer.Option("--seed", help="Of the draw.")] = 1,
    how: StudyRun,
) -> None:
    """Calibrate drawn gels by one indenter and more; count how often the intervals hold them.

    Example: python -m tests.studies gel --gels 100 --seed 1001 --jobs 2
    """
    how.measure(GelStudy(gels, seed))
