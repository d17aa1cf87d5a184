"""Study "fault-table": make every device, process and the computer fail, and record reactions."""

from __future__ import annotations

import shutil
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tacauchy_rig.app.cli.options import Jobs, JsonFile
from tacauchy_rig.app.cli.output import say, write_json, write_text
from tacauchy_rig.core.errors import DeviceError
from tests.studies.fault_table.cases import FaultCase, Moment, all_cases, select_cases

if TYPE_CHECKING:
    from tests.studies.fault_table.observation import Observation


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
    json_file: JsonFile = None,
) -> None:
    """Fail every device, process and the computer, at three moments; write the table.

    Sensors that lie do so from the start too, at each target. A case takes a minute and about half
    a processor; times of stopping hold what waits for one.
    """
    from tacauchy_rig.core.config.load import load_config
    from tacauchy_rig.core.parallel import parallel_map
    from tacauchy_rig.core.store.run_store import run_lock
    from tests.studies.fault_table.emulated_rig import write_case_config
    from tests.studies.fault_table.report import fault_page, summary_line

    chosen = select_cases(all_cases(), only=only or (), moments=moment or ())
    if list_only:
        for case in chosen:
            say(case.name)
        return
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
    write_json(json_file, {"cases": seen, "problems": {s.name: s.problems for s in seen}})
    say(summary_line(seen))
    say(f"table {out}")
    if unreached:
        raise DeviceError(
            f"nothing was observed in {', '.join(unreached)}",
            remedy="run the same command again; cases that are done are kept",
        )
    raise typer.Exit(1 if any(s.problems for s in seen) else 0)


def _observe(case: FaultCase, *, work: Path, again: bool, jobs: int) -> bool:
    """Make sure that a case is done; return False where its moment was never reached."""
    from tacauchy_rig.core.store.codec import dumps
    from tests.studies.fault_table.observe import observe_case
    from tests.studies.fault_table.report import computer

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
    from tacauchy_rig.core.store.codec import from_json, loads
    from tests.studies.fault_table.observation import Observation

    path = work / case.slug / OBSERVATION
    if not path.exists():
        return None
    return from_json(Observation, loads(path.read_bytes(), source=str(path)), source=str(path))
