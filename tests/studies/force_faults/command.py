"""Study "force-faults": slow and late faults of force sensor and arm, in simulated time."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Unpack

import typer

from tacauchy_rig.app.cli.output import Jobs, JsonFile, say, show_table, write_json, write_text
from tacauchy_rig.core.config.settings import RobotModel
from tacauchy_rig.core.parallel import parallel_map
from tacauchy_rig.core.tables import About, Table, table_of
from tests.studies.force_faults.runner import press
from tests.studies.force_faults.worlds import TRIALS, Kind, Place, World, faulty_world, honest_world

BEYOND = 0.1  # of a force, beyond its stated uncertainty: what no trial that passes may be off
REJECTED = 1 / 200  # of honest worlds
NOTE = (
    "Each world is a run of six presses into a GelSight Mini, drawn from the seed: gel, arm, "
    "drift, temperature, and what fails from which trial on. A fault takes or adds 10 to 50 % of "
    "the force, or 0.1 to 1 N of zero; it begins before, during or after the press of its trial, "
    "each trial in turn. The protocol's own servo, guard and judgement press it in simulated time. "
    "With a CB3 a weight of 200 g is hung before the first and after the last trial. A trial "
    "passes if the run calls it safe at its end; its stated uncertainty is that of the report."
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """What became of a world."""

    group: str
    world: World
    kind: str
    passed: int
    # How far the worst force that passed is off beyond its uncertainty [1]; -1 where none passed.
    beyond: float
    uncertainty: float  # largest stated of those that passed [1]
    above_n: float  # largest true force above what it may be [N]
    reason: str

    @property
    def is_bad(self) -> bool:
        """A trial passed with a force that is too far off, or the gel felt too much."""
        return self.beyond > BEYOND or self.above_n > 0.0


def force_faults(
    honest: Annotated[int, typer.Option("--honest", min=1, help="Honest worlds.")] = 200,
    faulty: Annotated[
        int, typer.Option("--faulty", min=1, help="Faulty worlds of each place of a fault.")
    ] = 120,
    seed: Annotated[int, typer.Option("--seed", help="Of the first world.")] = 1,
    jobs: Jobs = 1,
    out: Annotated[Path | None, typer.Option("--out", help="The page.")] = None,
    json_file: JsonFile = None,
) -> None:
    """Press runs in drawn worlds; count wrong forces that pass and honest runs that are rejected.

    Example: python -m tests.studies force-faults --seed 70001 --jobs 2
    """
    from tacauchy_rig.core.markdown_page import criteria_page

    worlds = [(HONEST, honest_world(seed + k)) for k in range(honest)]
    for number, place in enumerate(Place, start=1):
        first = seed + 10_000 * number
        worlds += [(place.value, faulty_world(first + k, place)) for k in range(faulty)]
    few, first = max(faulty // 3, 1), seed + 40_000
    for k in range(few):
        worlds.append((UNWEIGHED, faulty_world(first + k, Place.SENSOR, weighed=False)))
        worlds.append((ALIKE, faulty_world(first + few + k, Place.BOTH, alike=True)))
    found = []
    for done, (_, one) in enumerate(parallel_map(pressed, worlds, jobs=jobs), start=1):
        found.append(one)
        if one.is_bad or (one.group == HONEST and one.passed < TRIALS):
            say(f"{one.group} {one.world.seed}: {_told(one)}")
        if done % 50 == 0:
            say(f"{done} of {len(worlds)} worlds")
    undetected = [one.world for one in found if one.group == ALIKE and one.is_bad]
    found += [pressed((HUNG, replace(world, weighed=True))) for world in undetected]
    tables = tables_of(found)
    for table in tables:
        show_table(table)
    command = (
        f"python -m tests.studies force-faults --honest {honest} --faulty {faulty} --seed {seed}"
    )
    if out is not None:
        title = "Slow and late faults of force sensor and arm"
        write_text(out, criteria_page(tables, title=title, note=NOTE, command=command))
    write_json(json_file, {"tables": tables, "worlds": found})
    raise typer.Exit(0 if all(table.passed for table in tables) else 1)


HONEST, UNWEIGHED = "honest", "sensor, no weight on either arm"
ALIKE, HUNG = "the same in both", "the same in both, with a weight"


def pressed(task: tuple[str, World]) -> Found:
    """Press a world."""
    group, world = task
    run = press(world)
    fault = world.sensor or world.arm
    return Found(
        group=group,
        world=world,
        kind="none" if fault is None else fault.kind.value,
        passed=len(run.passed),
        beyond=run.beyond(),
        uncertainty=max((run.history.trials[k].uncertainty for k in run.passed), default=0.0),
        above_n=run.most_n,
        reason=run.reason,
    )


def tables_of(found: Sequence[Found]) -> list[Table]:
    """Return what became of honest worlds, of faulty ones by place and kind, and the failures."""
    honest = [one for one in found if one.group == HONEST]
    rejected = [one for one in honest if one.passed < TRIALS]
    alike = [one for one in found if one.group in (ALIKE, HUNG)]
    judged = [one for one in found if one.group not in (HONEST, ALIKE, HUNG)]
    return [
        _counted(
            [(model.value, [o for o in honest if o.world.model is model]) for model in RobotModel],
            title="Honest worlds",
            criterion="at most 1 of 200 is not passed whole, and no error exceeds its stated "
            f"uncertainty by {BEYOND:.0%} of the force",
            passed=len(rejected) <= REJECTED * max(len(honest), 200)
            and not any(one.is_bad for one in honest),
        ),
        _counted(
            _by_kind(judged),
            title="Worlds in which something fails",
            criterion="no trial passes with an error above its stated uncertainty and "
            f"{BEYOND:.0%} of the force, and no true force exceeds 1.5 x target + 0.5 N",
            passed=not any(one.is_bad for one in judged),
            note="Where both fail, the kind is that of the force sensor.",
        ),
        _counted(
            _by_kind(alike),
            title="The same fault in force sensor and arm at once",
            criterion="none: nothing but the stated gel, which is less certain, and a weight is "
            "independent of both; what passes is pressed again with a weight",
        ),
        table_of(
            [*rejected, *(one for one in found if one.is_bad)],
            {
                "seed": lambda one: one.world.seed,
                "where": lambda one: one.group,
                "arm": lambda one: one.world.model.value,
                "what happened": _told,
            },
            title="Every failure",
            criterion="none: the tables above judge them",
        ),
    ]


Row = tuple[str, Sequence[Found]]


def _by_kind(found: Sequence[Found]) -> list[Row]:
    rows = {(one.group, kind): list[Found]() for one in found for kind in Kind}
    for one in found:
        rows[one.group, Kind(one.kind)].append(one)
    return [(f"{group}: {kind.value}", some) for (group, kind), some in rows.items() if some]


def _counted(rows: Sequence[Row], **about: Unpack[About]) -> Table:
    def largest(values: Iterator[float]) -> float | None:
        most = max(values, default=None)
        return None if most is None else round(100.0 * most, 1)

    return table_of(
        rows,
        {
            "where": lambda row: row[0],
            "worlds": lambda row: len(row[1]),
            "passed whole": lambda row: sum(one.passed == TRIALS for one in row[1]),
            "no trial safe": lambda row: sum(not one.passed for one in row[1]),
            "largest stated uncertainty [%]": lambda row: largest(
                one.uncertainty for one in row[1] if one.passed
            ),
            "largest error beyond it [% of the force]": lambda row: largest(
                one.beyond for one in row[1] if one.passed
            ),
            f"beyond it by {BEYOND:.0%}": lambda row: sum(o.beyond > BEYOND for o in row[1]),
            "too much force": lambda row: sum(one.above_n > 0.0 for one in row[1]),
        },
        **about,
    )


def _told(one: Found) -> str:
    faults = (("sensor", one.world.sensor), ("arm", one.world.arm))
    what = "; ".join(
        f"{name}: {fault.kind.value} of {fault.size:+.2f} from {fault.moment:.1f} of trial "
        f"{fault.trial}"
        for name, fault in faults
        if fault is not None
    )
    return (
        f"{what or 'nothing fails'}; {one.passed} trials safe, error beyond the uncertainty "
        f"{one.beyond:+.1%}, force above its bound {one.above_n:+.2f} N. {one.reason}"
    )
