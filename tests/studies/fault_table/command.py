"""Study "fault-table": make every device, process and the computer fail, and record reactions."""

import os
import platform
import shutil
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from tacauchy_rig import __version__
from tacauchy_rig.app.cli.output import Found, Jobs, say, write_text
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.errors import DeviceError
from tacauchy_rig.core.markdown_page import page
from tests.studies.fault_table.cases import (
    LATER_MOMENTS,
    TARGET_N,
    FaultCase,
    Moment,
    all_cases,
    select_cases,
)
from tests.studies.fault_table.observation import (
    KILLED_EXIT_CODE,
    MOST_ABOVE_N,
    MOST_OF_TARGET,
    Observation,
)


def computer(jobs: int) -> str:
    """Return where cases are run, and how many at once: their times depend on it."""
    cases = "one case at a time" if jobs == 1 else f"{jobs} cases at once"
    return f"Linux on {platform.machine()}, {os.cpu_count()} processors, {cases}"


def summary_line(seen: Sequence[Observation]) -> str:
    """Return the whole table in one paragraph."""
    stopped = [s for s in seen if not s.went_on and s.arm.stopped_after_s is not None]
    worst_stop = max(stopped, key=lambda s: s.arm.stopped_after_s or 0.0, default=None)
    worst_rise = max(stopped, key=lambda s: s.force_rise_n, default=None)
    lost = sum(max(s.kept.lost_count, s.kept_after_resume.lost_count) for s in seen)
    resumed = sum(1 for s in seen if s.resumed and s.resumed[-1].exit_code == 0)
    went_on = sum(1 for s in seen if s.went_on)
    bad = sum(1 for s in seen if s.problems)
    parts = [f"{len(seen)} cases", f"{len(stopped)} ended the run, {went_on} did not"]
    if worst_stop is not None and worst_rise is not None:
        milliseconds = (worst_stop.arm.stopped_after_s or 0.0) * 1e3
        parts.append(f"slowest stop {milliseconds:.0f} ms ({worst_stop.name})")
        parts.append(f"largest rise {worst_rise.force_rise_n:.2f} N ({worst_rise.name})")
    parts += [f"acknowledged messages lost: {lost}", f"resumed to the end: {resumed}"]
    evils = "motion, a hang, silence, a loss, a lie or too much force"
    return f"{'; '.join(parts)}; cases that ended in {evils}: {bad}."


def fault_page(
    seen: Sequence[Observation], *, command: str, config: RigConfig, case_count: int
) -> str:
    """Return the document."""
    groups: dict[str, dict[str, list[Observation]]] = {}
    for each in seen:
        group = groups.setdefault(each.cause.partition(":")[0], {})
        group.setdefault(each.cause, []).append(each)
    return page(
        "tests.studies.fault_table",
        "fault_table.md.jinja",
        {
            "summary": summary_line(seen),
            "seen_count": len(seen),
            "case_count": case_count,
            "command": command,
            "version": __version__,
            "computers": sorted({each.made_on for each in seen if each.made_on}),
            "config": config,
            "moments": ", ".join(
                f"{each.delay_s:g} s into the {each.value}" for each in LATER_MOMENTS
            ),
            "target_n": TARGET_N,
            "most_of_target": MOST_OF_TARGET,
            "most_above_n": MOST_ABOVE_N,
            "repeated": sum(each.tries > 1 for each in seen),
            "groups": groups,
            "killed_exit_code": KILLED_EXIT_CODE,
        },
    )


OBSERVATION = "observation.json"
LOCK = "lock"


def fault_table(
    only: Annotated[
        list[str] | None,
        typer.Option("--only", metavar="PATTERN", help="Such as 'robot:*' or 'kill:*@dwell'."),
    ] = None,
    moment: Annotated[list[Moment] | None, typer.Option("--moment")] = None,
    list_only: Annotated[bool, typer.Option("--list", help="Name the cases and end.")] = False,
    out: Annotated[Path, typer.Option("--out", help="The table.")] = Path(
        "docs/results/fault_table.md"
    ),
    work: Annotated[
        Path, typer.Option("--work", help="Folder of the cases; those done there are kept.")
    ] = Path("runs/fault-table"),
    again: Annotated[bool, typer.Option("--again", help="Repeat cases that are done.")] = False,
    jobs: Jobs = 1,
) -> Found | None:
    """Fail every device, process and the computer, at three moments; write the table.

    Sensors that lie do so from the start too, at each target. A case takes a minute and about half
    a processor; times of stopping hold what waits for one.
    """
    from tacauchy_rig.core.config.load import load_config
    from tacauchy_rig.core.parallel import parallel_map
    from tacauchy_rig.core.store.atomic_write import run_lock
    from tests.studies.fault_table.emulated_rig import write_case_config

    chosen = select_cases(all_cases(), only=only or (), moments=moment or ())
    if list_only:
        for case in chosen:
            say(case.name)
        return None
    work.mkdir(parents=True, exist_ok=True)
    with run_lock(work / LOCK):
        observe = partial(_observe, work=work, again=again, jobs=jobs)
        done = parallel_map(observe, chosen, jobs=jobs)
        unreached = [case.name for case, is_done in done if not is_done]
    seen = [found for case in all_cases() if (found := _load(case, work)) is not None]
    write_text(
        out,
        fault_page(
            seen,
            command="python -m tests.studies fault-table",
            config=load_config(write_case_config(work)).config,
            case_count=len(all_cases()),
        ),
    )
    say(summary_line(seen))
    say(f"table {out}")
    if unreached:
        raise DeviceError(
            f"nothing was observed in {', '.join(unreached)}",
            remedy="run the same command again; cases that are done are kept",
        )
    return Found(
        {"cases": seen, "problems": {s.name: s.problems for s in seen}},
        passed=not any(s.problems for s in seen),
    )


def _observe(case: FaultCase, *, work: Path, again: bool, jobs: int) -> bool:
    """Make sure that a case is done; return False where its moment was never reached."""
    from tacauchy_rig.core.store.json_codec import dumps
    from tests.studies.fault_table.observe import observe_case

    if not again and _load(case, work) is not None:
        say(f"{case.name}: done before")
        return True
    folder, started_s = work / case.slug, time.monotonic()
    try:
        seen = replace(observe_case(case, folder), made_on=computer(jobs))
    except Exception as error:  # noqa: BLE001 - a case's top: the others still run
        say(f"{case.name}: {type(error).__name__}: {error}")
        return False
    (folder / OBSERVATION).write_bytes(dumps(seen))
    if not seen.problems:
        shutil.rmtree(folder / "runs")
    say(f"{case.name}: {_headline(seen)} [{time.monotonic() - started_s:.0f} s]")
    return True


def _headline(seen: Observation) -> str:
    if seen.problems:
        return f"PROBLEM: {'; '.join(seen.problems)}"
    if seen.went_on or seen.arm.stopped_after_s is None:
        return f"went on, exit {seen.exit_code}"
    return (
        f"stopped in {seen.arm.stopped_after_s * 1e3:.0f} ms, +{seen.force_rise_n:.2f} N, "
        f"exit {seen.exit_code}"
    )


def _load(case: FaultCase, work: Path) -> Observation | None:
    from tacauchy_rig.core.store.json_codec import from_json, loads

    path = work / case.slug / OBSERVATION
    if not path.exists():
        return None
    return from_json(Observation, loads(path.read_bytes(), source=str(path)), source=str(path))
