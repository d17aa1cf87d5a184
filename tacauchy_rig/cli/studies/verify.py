"""``tacauchy-rig verify``: the simulator against what others found, as a table and a page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sim.studies.verification.catalogue import ON_REQUEST, SECTIONS
from sim.studies.verification.page import TITLE, markdown
from sim.studies.verification.section import Section
from tacauchy_rig.cli.options import JsonFile
from tacauchy_rig.cli.output import complain, say, write_json, write_text
from tacauchy_rig.cli.studies.section_table import result_word, show_section
from tacauchy_rig.cli.studies.side_by_side import Jobs, side_by_side
from tacauchy_rig.cli.versions import machine, versions
from tacauchy_rig.errors import ConfigError, RigError


def verify(
    sections: Annotated[
        list[str] | None,
        typer.Option(
            "--sections",
            metavar="NAME[,NAME]",
            help=f"Of {', '.join(SECTIONS)}; by default all but {', '.join(ON_REQUEST)}.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="Write a page, such as docs/verification.md."),
    ] = None,
    jobs: Jobs = 1,
    json_file: JsonFile = None,
) -> None:
    """Press what has a known answer, and say how far off the simulator is; takes minutes."""
    names = _chosen(sections)
    found: dict[str, Section] = {}
    complain(f"{len(names)} sections: {', '.join(names)}")
    for name, section in side_by_side(_measured, names, jobs=jobs):
        found[name] = section
        complain(f"{name}: {result_word(section)}")
        show_section(section)
        if out is not None:
            write_text(out, _page(found, out))
    if out is not None:
        say(f"page {out}")
    write_json(json_file, {"sections": found, "versions": versions()})
    missed = [name for name, section in found.items() if not section.passed]
    say(f"missed: {', '.join(missed)}" if missed else "no criterion was missed")
    raise typer.Exit(1 if missed else 0)


def _chosen(given: list[str] | None) -> list[str]:
    """Return the names that were asked for, in the order of the page; the usual if none were."""
    asked = [name.strip() for text in given or [] for name in text.split(",") if name.strip()]
    for name in asked:
        if name not in SECTIONS:
            raise ConfigError(
                f"--sections {name}: there is no such section",
                remedy=f"use one or more of {', '.join(SECTIONS)}",
            )
    return [name for name in SECTIONS if (name in asked if asked else name not in ON_REQUEST)]


def _measured(name: str) -> Section:
    """Measure a section; an error of its presses is its result, and the others still run."""
    try:
        return SECTIONS[name]()
    except RigError as error:
        return Section(
            title=name,
            columns=(),
            rows=(),
            criterion="it runs to its end",
            passed=False,
            note=f"It ended with an error: {error.message}.",
        )


def _page(found: dict[str, Section], out: Path) -> str:
    """Return the page of what was measured so far, with the command that makes just that."""
    chosen = "" if list(found) == _chosen(None) else f" --sections {','.join(found)}"
    sections = list(found.values())
    return markdown(
        sections,
        title=sections[0].title if len(sections) == 1 else TITLE,
        command=f"tacauchy-rig verify{chosen} --out {out}",
        versions=versions(),
        machine=machine(),
    )
