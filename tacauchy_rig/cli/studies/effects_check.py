"""``tacauchy-rig effects-check``: plans of scenes that differ, held against everything on."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sim.scene.scene import Effect
from tacauchy_rig.cli.options import Jobs, JsonFile
from tacauchy_rig.cli.output import say, write_json, write_text
from tacauchy_rig.errors import ConfigError

if TYPE_CHECKING:
    from sim.studies.effects_check.check import EffectCase, EffectCheck


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
    from tacauchy_rig.side_by_side import side_by_side

    chosen = _chosen(only or [])
    if list_only:
        for case in chosen:
            say(f"{case.name:22} {case.shows}")
        return
    checks: list[EffectCheck] = []
    measure = partial(_checked, one_by_one=one_by_one)
    for _, check in side_by_side(measure, [case.name for case in chosen], jobs=jobs):
        checks.append(check)
        say(_line(check))
        # After every scene, so that Ctrl-C leaves what was found until then.
        if out is not None:
            command = f"tacauchy-rig effects-check --out {out}"
            write_text(out, _page(checks, command))
        write_json(json_file, {"scenes": [check.as_json() for check in checks]})
    raise typer.Exit(0 if all(check.passed for check in checks) else 1)


def _chosen(names: list[str]) -> list[EffectCase]:
    from sim.studies.effects_check.check import EFFECT_CASES

    known = {case.name: case for case in EFFECT_CASES}
    unknown = [name for name in names if name not in known]
    if unknown:
        raise ConfigError(
            f"no scene is called {', '.join(map(repr, unknown))}",
            remedy=f"choose from {', '.join(map(repr, known))}",
        )
    return [known[name] for name in names] or list(known.values())


def _checked(name: str, *, one_by_one: bool) -> EffectCheck:
    from sim.studies.effects_check.check import check_effects

    return check_effects(_chosen([name])[0], one_by_one=one_by_one)


def _line(check: EffectCheck) -> str:
    verdict = "ok" if check.passed else "MISSED"
    text = (
        f"{check.case.name:22} {verdict:6} {check.difference:9.2e} of {check.plan.tolerance:.2e}, "
        f"{check.time_ratio:5.1f} times the time with {_names(check.added)} on"
    )
    apart = "; ".join(f"{effect.value} apart: {why}" for effect, why in check.left_apart)
    return f"{text} ({apart})" if apart else text


def _page(checks: Sequence[EffectCheck], command: str) -> str:
    from sim.studies.effects_check.check import EFFECT_CASES
    from tacauchy_rig.page import page

    apart: dict[tuple[Effect, str], list[str]] = {}
    for check in checks:
        for reason in check.left_apart:
            apart.setdefault(reason, []).append(check.case.name)
    facts = {
        "command": command,
        "checks": checks,
        "case_count": len(EFFECT_CASES),
        "missed": [check.case.name for check in checks if not check.passed],
        "apart": apart,
        "names": _names,
        "percent": _percent,
    }
    return page("tacauchy_rig.cli.studies", "effects.md.jinja", facts)


def _names(effects: Sequence[Effect]) -> str:
    return ", ".join(effect.value for effect in effects) or "nothing"


def _percent(value: float) -> str:
    return f"{float(f'{value * 100:.2g}'):g} %"
