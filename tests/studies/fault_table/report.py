"""The fault table as Markdown, for operators."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence

from tacauchy_rig import __version__
from tacauchy_rig.core.config.model import RigConfig
from tacauchy_rig.core.page import page
from tests.studies.fault_table.cases import LATER_MOMENTS, TARGET_N
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
    """Return the document.

    Args:
        seen: What was observed, in the order of the table.
        command: What made it.
        config: Of the runs.
        case_count: How many cases there are.
    """
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
