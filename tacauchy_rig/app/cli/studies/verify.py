"""``tacauchy-rig verify``: the simulator against what others found, as a table and a page."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sim.studies.verification.catalogue import ON_REQUEST, SECTIONS
from tacauchy_rig.app.cli.options import Jobs, JsonFile
from tacauchy_rig.app.cli.output import complain, say, show_table, write_json, write_text
from tacauchy_rig.core.errors import ConfigError, RigError
from tacauchy_rig.core.versions import versions

if TYPE_CHECKING:
    from tacauchy_rig.core.tables import Table


_TITLE = "Verification of the simulator"
_SOURCE = "Every number comes from the scenes, meshes and solver that `tacauchy-rig press` uses"
_COMMANDS = "; the command below a table gives one of its rows"
_AGAIN = ". Times apart, the numbers are the same when it is run again."


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
        typer.Option(
            "--out", metavar="FILE", help="Write a page, such as docs/results/verification.md."
        ),
    ] = None,
    jobs: Jobs = 1,
    json_file: JsonFile = None,
) -> None:
    """Press what has a known answer, and say how far off the simulator is; takes minutes.

    Example: tacauchy-rig study verify --sections punch
    """
    from tacauchy_rig.core.side_by_side import side_by_side

    names = _chosen(sections)
    found: dict[str, Table] = {}
    complain(f"{len(names)} sections: {', '.join(names)}")
    for name, section in side_by_side(_measured, names, jobs=jobs):
        found[name] = section
        complain(f"{name}: {section.result}")
        show_table(section)
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


def _measured(name: str) -> Table:
    """Measure a section; an error of its presses is its result, and the others still run."""
    from tacauchy_rig.core.tables import Table

    try:
        return SECTIONS[name]()
    except RigError as error:
        return Table(
            title=name,
            columns=(),
            rows=(),
            criterion="it runs to its end",
            passed=False,
            note=f"It ended with an error: {error.message}.",
        )


def _page(found: dict[str, Table], out: Path) -> str:
    """Return the page of what was measured so far, with the command that makes just that."""
    from tacauchy_rig.core.page import criteria_page

    chosen = "" if list(found) == _chosen(None) else f" --sections {','.join(found)}"
    tables = list(found.values())
    has_commands = any(table.command for table in tables)
    return criteria_page(
        tables,
        title=tables[0].title if len(tables) == 1 else _TITLE,
        note=f"{_SOURCE}{_COMMANDS if has_commands else ''}{_AGAIN}",
        command=f"tacauchy-rig verify{chosen} --out {out}",
    )
