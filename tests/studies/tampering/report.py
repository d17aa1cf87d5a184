"""The tampering table as Markdown, for operators."""

from __future__ import annotations

from collections.abc import Sequence

from tacauchy_rig import __version__
from tacauchy_rig.core.page import page
from tacauchy_rig.core.tables import Table
from tests.studies.tampering.copy import Care
from tests.studies.tampering.observe import Observation

_SHOWN = 3
"""Criteria that a cell names; one edit often breaks many."""
_FOLLOWS = "replay_files"
"""Missed whenever anything is that a replay was made from; named last."""


def summary_line(seen: Sequence[Observation]) -> str:
    """Return the whole table in one paragraph."""
    parts = [f"{len({s.case for s in seen})} kinds of tampering"]
    for care in Care:
        own = [s for s in seen if s.care is care]
        unseen = sum(bool(s.unseen_by) for s in own)
        parts.append(f"{care.value}: {len(own) - unseen} of {len(own)} named by every command")
    return "; ".join(parts) + "."


def misses(seen: Sequence[Observation]) -> list[Observation]:
    """Return what was not named by every command though its hashes were wrong."""
    return [s for s in seen if s.unseen_by and s.care is not Care.RESEALED]


def tamper_page(seen: Sequence[Observation], *, command: str, press_count: int) -> str:
    """Return the document.

    Args:
        seen: What was observed, in the order of the table.
        command: What made it.
        press_count: Presses of the run that was tampered with.
    """
    groups: dict[str, list[str]] = {}
    for case in dict.fromkeys(s.case for s in seen):
        groups.setdefault(case.partition(":")[0], []).append(case)
    unseen = [s for s in seen if s.care is Care.RESEALED and s.unseen_by]
    return page(
        "tests.studies.tampering",
        "tamper_table.md.jinja",
        {
            "summary": summary_line(seen),
            "command": command,
            "version": __version__,
            "press_count": press_count,
            "tables": {name: _table(cases, seen) for name, cases in groups.items()},
            "unseen": [s for s in unseen if not s.is_judged],
            "judged": [s for s in unseen if s.is_judged],
        },
    )


def _table(cases: Sequence[str], seen: Sequence[Observation]) -> Table:
    found = {(s.case, s.care): _cell(s) for s in seen}
    return Table(
        columns=("what is done", *(care.value for care in Care)),
        rows=tuple(
            (case.partition(": ")[2], *(found.get((case, care), "–") for care in Care))
            for case in cases
        ),
    )


def _cell(seen: Observation) -> str:
    if seen.is_judged or not seen.names:
        return f"verdict: {', '.join(seen.names)}" if seen.names else "nothing"
    names = sorted(seen.names, key=lambda name: name == _FOLLOWS)
    shown = ", ".join(names[:_SHOWN])
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    unseen = f"; not by {', '.join(seen.unseen_by)}" if seen.unseen_by else ""
    return f"{shown}{more}{unseen}"
