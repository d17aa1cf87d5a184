"""The verification as a page of Markdown."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence

from sim.studies.verification.section import Section

_WIDTH = 100


TITLE = "Verification of the simulator"
_SOURCE = "Every number comes from the scenes, meshes and solver that `tacauchy-rig press` uses"
_COMMANDS = "; the command below a table gives one of its rows"
_AGAIN = ". Times apart, the numbers are the same when it is run again."


def markdown(
    sections: Sequence[Section],
    *,
    command: str,
    versions: Mapping[str, str],
    machine: str,
    title: str = TITLE,
    note: str | None = None,
    image: str = "",
) -> str:
    """Return the page.

    Args:
        command: What made it.
        versions: Of what the numbers depend on.
        machine: Where it ran, in words.
        note: What a reader has to know before all sections; None says where the numbers of the
            verification come from.
        image: File of a figure that stands before them, beside the page; empty for none.
    """
    said = _verification_note(sections) if note is None else note
    lines = [f"# {title}", "", f"**{_verdict(sections)}.**", ""]
    lines += _filled(f"Written by `{command}` on {machine}. {said}")
    lines += [f"![{title}]({image})", ""] if image else []
    lines += ["| section | result | criterion |", "|---|---|---|"]
    lines += [f"| {s.title} | {result(s)} | {s.criterion} |" for s in sections]
    for section in sections:
        lines += ["", *_section(section)]
    lines += ["", "## Versions", "", ", ".join(f"{k} {v}" for k, v in versions.items())]
    return "\n".join(lines) + "\n"


def _verdict(sections: Sequence[Section]) -> str:
    missed = sum(not section.passed for section in sections)
    if len(sections) == 1:
        return f"1 section: {result(sections[0]).strip('*')}"
    return f"{len(sections)} sections, " + (
        f"{missed} of them missed" if missed else "every criterion is met"
    )


def _verification_note(sections: Sequence[Section]) -> str:
    has_commands = any(section.command for section in sections)
    return f"{_SOURCE}{_COMMANDS if has_commands else ''}{_AGAIN}"


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
