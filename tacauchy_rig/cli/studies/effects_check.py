"""``tacauchy-rig effects-check``: plans of scenes that differ, held against everything on."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from sim.studies.effects_check.cases import EffectCase, effect_cases
from sim.studies.effects_check.check import EffectCheck, check_effects
from tacauchy_rig.cli.options import JsonFile
from tacauchy_rig.cli.output import say, write_json, write_text
from tacauchy_rig.cli.studies.effects_page import line, markdown
from tacauchy_rig.cli.studies.side_by_side import Jobs, side_by_side
from tacauchy_rig.errors import ConfigError


def effects_check(
    only: Annotated[
        list[str] | None, typer.Option("--only", help="A scene by name; may be repeated.")
    ] = None,
    list_only: Annotated[bool, typer.Option("--list", help="Name the scenes and stop.")] = False,
    one_by_one: Annotated[
        bool, typer.Option(help="Also try to do without each effect that a plan keeps.")
    ] = True,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Write the page there.")
    ] = None,
    jobs: Jobs = 1,
    json_file: JsonFile = None,
) -> None:
    """Press scenes under their plans and with everything on; say what that changes and costs."""
    chosen = _chosen(only or [])
    if list_only:
        for case in chosen:
            say(f"{case.name:22} {case.shows}")
        return
    checks: list[EffectCheck] = []
    measure = partial(_checked, one_by_one=one_by_one)
    for _, check in side_by_side(measure, [case.name for case in chosen], jobs=jobs):
        checks.append(check)
        say(line(check))
        # After every scene, so that Ctrl-C leaves what was found until then.
        if out is not None:
            command = f"tacauchy-rig effects-check --out {out}"
            write_text(out, markdown(checks, command=command, case_count=len(effect_cases())))
        write_json(json_file, {"scenes": [check.as_json() for check in checks]})
    raise typer.Exit(0 if all(check.passed for check in checks) else 1)


def _chosen(names: list[str]) -> list[EffectCase]:
    known = {case.name: case for case in effect_cases()}
    unknown = [name for name in names if name not in known]
    if unknown:
        raise ConfigError(
            f"no scene is called {', '.join(map(repr, unknown))}",
            remedy=f"choose from {', '.join(map(repr, known))}",
        )
    return [known[name] for name in names] or list(known.values())


def _checked(name: str, *, one_by_one: bool) -> EffectCheck:
    return check_effects(_chosen([name])[0], one_by_one=one_by_one)
