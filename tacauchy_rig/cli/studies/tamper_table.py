"""``tacauchy-rig tamper-table``: tamper with copies of a run, and write down what is noticed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tacauchy_rig.cli.options import JsonFile, RunFolder
from tacauchy_rig.cli.output import complain, say, write_json, write_text
from tacauchy_rig.errors import RecordError

if TYPE_CHECKING:
    from tacauchy_rig.store.run_store import RunStore
    from tacauchy_rig.tampering.observe import Observation


def tamper_table(
    folder: RunFolder,
    out: Annotated[Path, typer.Option("--out", help="The table.")] = Path("docs/tamper_table.md"),
    json_file: JsonFile = None,
) -> None:
    """Tamper with copies of a finished, replayed run in every way; write what is noticed."""
    from tacauchy_rig.store.run_store import RunStore
    from tacauchy_rig.tampering.cases import all_cases
    from tacauchy_rig.tampering.observe import observe
    from tacauchy_rig.tampering.report import misses, summary_line, tamper_page

    store = RunStore.open(folder)
    _require_whole(store)
    seen: list[Observation] = []
    for case in all_cases():
        for care in case.cares:
            found = observe(case, care, folder)
            seen.append(found)
            named = next((names for names in found.named.values() if names), found.judged)
            say(f"{case.name} ({care.value}): {', '.join(named) or 'nothing'}")
    count = len(store.config.protocol.force_targets)
    write_text(out, tamper_page(seen, command="tacauchy-rig tamper-table RUN", press_count=count))
    write_json(json_file, {"cases": seen})
    say(summary_line(seen))
    say(f"table {out}")
    for missed in misses(seen):
        complain(f"{missed.case} ({missed.care.value}) is not named by {missed.unseen_by}")
    raise typer.Exit(1 if misses(seen) else 0)


def _require_whole(store: RunStore) -> None:
    """Refuse a run that has nothing to tamper with, or was tampered with.

    Raises:
        RecordError: Fewer than two presses passed, it was not replayed, or it is not whole.
    """
    from tacauchy_rig.store.check.run import check_run
    from tacauchy_rig.tampering.recordings import OTHER

    root = store.paths.root
    wrong = list(check_run(store).missed())
    if wrong:
        raise RecordError(f"{root}: is not whole: {wrong[0]}", remedy="give another run")
    if not store.replays() or store.accepted(OTHER) is None:
        raise RecordError(
            f"{root}: needs {OTHER} passed presses and a replay",
            remedy="`tacauchy-rig dry-run` makes such a run",
        )
