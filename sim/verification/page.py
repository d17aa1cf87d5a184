"""The verification as a page of Markdown."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence

from sim.verification.section import Section

_WIDTH = 100


TITLE = "Verification of the simulator"
NOTE = (
    "Every number comes from the scenes, meshes and solver that `tacauchy-rig press` uses; the "
    "command below a table gives one of its rows. Times apart, the numbers are the same when it is "
    "run again."
)


def markdown(
    sections: Sequence[Section],
    *,
    command: str,
    versions: Mapping[str, str],
    machine: str,
    title: str = TITLE,
    note: str = NOTE,
    image: str = "",
) -> str:
    """Return the page.

    Args:
        command: What made it.
        versions: Of what the numbers depend on.
        machine: Where it ran, in words.
        note: What a reader has to know before all sections.
        image: File of a figure that stands before them, beside the page; empty for none.
    """
    missed = [section for section in sections if not section.passed]
    verdict = "every criterion is met" if not missed else f"{len(missed)} of them missed"
    lines = [f"# {title}", ""]
    lines += [f"**{len(sections)} sections, {verdict}.**", ""]
    lines += _filled(f"Written by `{command}` on {machine}. {note}")
    lines += [f"![{title}]({image})", ""] if image else []
    lines += ["| section | result | criterion |", "|---|---|---|"]
    lines += [f"| {s.title} | {result(s)} | {s.criterion} |" for s in sections]
    for section in sections:
        lines += ["", *_section(section)]
    lines += ["", "## Versions", "", ", ".join(f"{k} {v}" for k, v in versions.items())]
    return "\n".join(lines) + "\n"


def result(section: Section) -> str:
    """Return a section's result in a word."""
    if section.criterion.startswith("none"):
        return "reported"
    return "met" if section.passed else "**missed**"


def cell(value: str | float | None) -> str:
    """Return a table's cell as text: counts whole, numbers to four digits."""
    if value is None:
        return ""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _section(section: Section) -> list[str]:
    lines = [f"## {section.title}", ""]
    lines += _filled(f"Criterion: {section.criterion}. Result: {result(section)}.")
    if section.rows:
        lines.append("| " + " | ".join(section.columns) + " |")
        lines.append("|" + "---|" * len(section.columns))
        lines += ["| " + " | ".join(cell(v) for v in row) + " |" for row in section.rows]
        lines.append("")
    lines += _filled(section.note)
    if section.command:
        lines += ["```", section.command, "```"]
    return lines[:-1] if lines[-1] == "" else lines


def _filled(text: str) -> list[str]:
    if not text:
        return []
    return [*textwrap.wrap(text, _WIDTH, break_long_words=False, break_on_hyphens=False), ""]
