"""The hard cases as lines and as a page for readers."""

from __future__ import annotations

import os
import platform
import textwrap
from collections.abc import Mapping, Sequence

from sim.studies.hard_cases.case import CaseResult

_WIDTH = 100
_COUNT = 19


def verdict(result: CaseResult) -> str:
    """Return ``pass`` or ``FAIL``."""
    return "pass" if result.passed else "FAIL"


def shown_numbers(result: CaseResult) -> list[str]:
    """Return what was measured, one ``name = value`` for each number."""
    return [f"{name} = {_shown(value)}" for name, value in result.measured.items()]


def summary_line(results: Sequence[CaseResult]) -> str:
    """Return how many cases passed, and which did not."""
    failed = [str(result.number) for result in results if not result.passed]
    left = f"; failed: {', '.join(failed)}" if failed else ""
    return f"{len(results) - len(failed)} of {len(results)} hard cases pass{left}."


def markdown(results: Sequence[CaseResult], *, command: str, versions: Mapping[str, str]) -> str:
    """Return the page.

    Args:
        results: In the order of the page.
        command: What made it.
        versions: Of everything the numbers depend on.
    """
    numerical = ("tacauchy-rig", "python", "warp-lang", "numpy", "scipy", "pypardiso")
    used = ", ".join(f"{name} {versions[name]}" for name in numerical if name in versions)
    preface = (
        f"Written by `{command}` with {used} on {platform.system()}, {platform.machine()}, "
        f"{os.cpu_count()} processors. Each case ran in a process of its own and was ended at its "
        "time limit; seconds include the start of that process and depend on what else the "
        "machine did. Exit code 1 means that a case failed."
    )
    lines = ["# Hard cases", "", f"**{summary_line(results)}**", ""]
    if len(results) < _COUNT:
        lines += [f"{len(results)} of the {_COUNT} cases are on this page.", ""]
    lines += [_filled(preface), "", "| row | case | verdict | seconds |", "|---|---|---|---|"]
    for result in results:
        lines.append(
            f"| {result.number} | {result.name} | {verdict(result)} | {result.wall_s:.0f} |"
        )
    for result in results:
        lines += ["", f"## {result.number}. {result.name}: {verdict(result)}", ""]
        lines += [_filled(f"Criterion: {result.criterion}."), ""]
        if result.failure:
            lines += [_filled(f"No numbers: {result.failure}")]
        else:
            lines += ["| measured | |", "|---|---|"]
            lines += [
                f"| {_escaped(name)} | {_escaped(_shown(value))} |"
                for name, value in result.measured.items()
            ]
    return "\n".join(lines) + "\n"


def _shown(value: float | int | bool | str) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _escaped(text: str) -> str:
    return text.replace("_", r"\_").replace("|", r"\|").replace("\n", " ")


def _filled(text: str) -> str:
    return textwrap.fill(text, _WIDTH, break_long_words=False, break_on_hyphens=False)
