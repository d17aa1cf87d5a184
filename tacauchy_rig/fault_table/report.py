"""The fault table as Markdown, for operators."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Sequence

from tacauchy_rig import __version__
from tacauchy_rig.config.model import RigConfig
from tacauchy_rig.fault_table.cases import Moment
from tacauchy_rig.fault_table.observation import KILLED_EXIT_CODE, Observation
from tacauchy_rig.page import page
from tacauchy_rig.tables import Table, table_of


def summary_line(seen: Sequence[Observation]) -> str:
    """Return the whole table in one paragraph."""
    stopped = [s for s in seen if not s.went_on and s.arm.stopped_after_s is not None]
    worst_stop = max(stopped, key=lambda s: s.arm.stopped_after_s or 0.0, default=None)
    worst_rise = max(stopped, key=lambda s: s.force_rise_n, default=None)
    lost = sum(max(s.kept.lost_count, s.kept_after_resume.lost_count) for s in seen)
    resumed = sum(1 for s in seen if s.resumed and s.resumed[-1].exit_code == 0)
    bad = sum(1 for s in seen if s.problems)
    parts = [f"{len(seen)} cases", f"{len(stopped)} ended the run, {_went_on(seen)} did not"]
    if worst_stop is not None and worst_rise is not None:
        milliseconds = (worst_stop.arm.stopped_after_s or 0.0) * 1e3
        parts.append(f"slowest stop {milliseconds:.0f} ms ({worst_stop.name})")
        parts.append(f"largest rise {worst_rise.force_rise_n:.2f} N ({worst_rise.name})")
    parts += [f"acknowledged messages lost: {lost}", f"resumed to the end: {resumed}"]
    return f"{'; '.join(parts)}; cases that ended in motion, a hang, silence or a loss: {bad}."


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
    groups: dict[str, dict[str, Table]] = {}
    for cause in dict.fromkeys(each.cause for each in seen):
        group = groups.setdefault(cause.partition(":")[0], {})
        group[cause] = _table([each for each in seen if each.cause == cause])
    return page(
        "tacauchy_rig.fault_table",
        "fault_table.md.jinja",
        {
            "summary": summary_line(seen),
            "seen_count": len(seen),
            "case_count": case_count,
            "command": command,
            "version": __version__,
            "machine": f"Linux on {platform.machine()}, {os.cpu_count()} processors",
            "config": config,
            "moments": ", ".join(f"{each.delay_s:g} s into the {each.value}" for each in Moment),
            "repeated": sum(each.tries > 1 for each in seen),
            "groups": groups,
        },
    )


def _table(seen: Sequence[Observation]) -> Table:
    columns: dict[str, Callable[[Observation], str]] = {
        "when": lambda each: each.name.partition("@")[2],
        "the arm": _arm,
        "true force": _force,
        "messages acknowledged / readable": _kept,
        "the operator was told": lambda each: _told(each).replace("|", "/"),
        "exit": _exit,
        "`resume`": _resume,
    }
    return table_of(seen, columns)


def _arm(seen: Observation) -> str:
    arm = seen.arm
    problems = "".join(f"; **{problem}**" for problem in seen.problems)
    if seen.went_on:
        return f"went on, and stands at home{problems}"
    if arm.stopped_after_s is None:
        return f"did not stop{problems}"
    text = f"stood still after {arm.stopped_after_s * 1e3:.0f} ms"
    if arm.descended_m >= 1e-6:
        text += f", {arm.descended_m * 1e3:.3f} mm further down"
    if arm.raised_after_m >= 1e-6:
        text += f", then went up {arm.raised_after_m * 1e3:.2f} mm"
    return text + problems


def _force(seen: Observation) -> str:
    if seen.went_on:
        return f"{seen.force_at_fault_n + seen.force_rise_n:.2f} N at most, as planned"
    return f"+{seen.force_rise_n:.2f} N (from {seen.force_at_fault_n:.2f} N)"


def _kept(seen: Observation) -> str:
    kept = seen.kept
    text = f"{sum(kept.acknowledged.values())} / {sum(kept.readable.values())}"
    return f"{text}, **{kept.lost_count} lost**" if kept.lost_count else f"{text}, none lost"


def _told(seen: Observation) -> str:
    first = seen.told.partition("\n")[0].removeprefix("error: ")
    if seen.exit_code == KILLED_EXIT_CODE:
        return f"nothing (killed); the journal says: {first}" if first else "nothing (killed)"
    if seen.went_on:
        told = "; ".join(seen.told.splitlines())
        return f"{told}{_streams(seen)}".strip()
    return first


def _streams(seen: Observation) -> str:
    rates = seen.measured
    if not rates:
        return ""
    parts = [
        f"{name} {rates.get(f'{name}_rate_hz', 0.0):.1f} Hz, "
        f"{rates.get(f'{name}_lost_count', 0.0):.0f} counted as lost, "
        f"longest gap {rates.get(f'{name}_gap_max_ms', 0.0):.0f} ms"
        for name in ("force", "image")
    ]
    return f" ({'; '.join(parts)})"


def _exit(seen: Observation) -> str:
    if seen.exit_code < 0:
        return f"killed ({128 - seen.exit_code} in a shell)"
    return str(seen.exit_code)


def _resume(seen: Observation) -> str:
    if not seen.resumed or seen.resumed[-1].exit_code != 0:
        return "**not finished**"
    return "finished" if len(seen.resumed) == 1 else f"finished at try {len(seen.resumed)}"


def _went_on(seen: Sequence[Observation]) -> int:
    return sum(1 for s in seen if s.went_on)
