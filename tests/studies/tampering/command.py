"""Study "tampering": tamper with copies of a run and record which checks notice."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tacauchy_rig.app.cli.options import JsonFile, RunFolder
from tacauchy_rig.app.cli.output import complain, say, write_json, write_text
from tacauchy_rig.core.errors import RecordError

if TYPE_CHECKING:
    from tacauchy_rig.core.store.run_store import RunStore
    from tests.studies.tampering.observe import Observation


def tamper_table(
    folder: RunFolder,
    out: Annotated[Path, typer.Option("--out", help="The table.")] = Path(
        "docs/results/tamper_table.md"
    ),
    json_file: JsonFile = None,
) -> None:
    """Tamper with copies of a finished, replayed run in every way; write what is noticed."""
    from tacauchy_rig.core.store.run_store import RunStore
    from tests.studies.tampering.cases import all_cases
    from tests.studies.tampering.observe import observe, verdict_of
    from tests.studies.tampering.report import misses, summary_line, tamper_page

    store = RunStore.open(folder)
    _require_whole(store)
    missed = verdict_of(folder)
    seen: list[Observation] = []
    for case in all_cases():
        for care in case.cares:
            found = observe(case, care, folder, missed=missed)
            seen.append(found)
            say(f"{case.name} ({care.value}): {', '.join(found.names) or 'nothing'}")
    count = len(store.config.protocol.force_targets)
    write_text(
        out, tamper_page(seen, command="python -m tests.studies tampering RUN", press_count=count)
    )
    write_json(json_file, {"cases": seen})
    say(summary_line(seen))
    say(f"table {out}")
    for miss in misses(seen):
        complain(f"{miss.case} ({miss.care.value}) is not named by {', '.join(miss.unseen_by)}")
    raise typer.Exit(1 if misses(seen) else 0)


def _require_whole(store: RunStore) -> None:
    """Refuse a run that has nothing to tamper with, or was tampered with.

    Raises:
        RecordError: It is not whole or not replayed, fewer than two presses passed, or nothing was
            emulated.
    """
    from tacauchy_rig.core.store.check.run import check_run
    from tests.studies.tampering.case import OTHER

    root = store.paths.root
    wrong = list(check_run(store).missed())
    if wrong:
        raise RecordError(f"{root}: is not whole: {wrong[0]}", remedy="give another run")
    if not store.replays() or store.accepted(OTHER) is None or not store.paths.truth.exists():
        raise RecordError(
            f"{root}: needs {OTHER} passed presses, a replay and the truth of what was emulated",
            remedy="`tacauchy-rig dry-run` makes such a run",
        )
