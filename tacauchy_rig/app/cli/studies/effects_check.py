"""``tacauchy-rig effects-check``: plans of scenes that differ, held against everything on."""

from __future__ import annotations

import json
import shlex
from bisect import insort
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from typing import TYPE_CHECKING, Annotated

import typer

from sim.scene.scene import Effect
from tacauchy_rig.app.cli.options import Jobs, JsonFile
from tacauchy_rig.app.cli.output import complain, say, write_json, write_text
from tacauchy_rig.core.errors import ConfigError, naming
from tacauchy_rig.core.quantities import Dimension, parse_quantity
from tacauchy_rig.core.selection import selected

if TYPE_CHECKING:
    from sim.studies.effects_check.check import EffectCase, EffectCheck


_Found = Annotated[
    list[Path] | None,
    typer.Option(
        "--found",
        metavar="FILE",
        help="JSON of an earlier run, whose scenes are not pressed again, unless --only names one "
        "that it could not press; may be repeated.",
    ),
]


def effects_check(
    only: Annotated[
        list[str] | None,
        typer.Option("--only", help="A scene by name, or a drawn one's number; may be repeated."),
    ] = None,
    list_only: Annotated[bool, typer.Option("--list", help="Name the scenes and stop.")] = False,
    random: Annotated[
        int, typer.Option("--random", metavar="N", help="Draw so many scenes instead.")
    ] = 0,
    seed: Annotated[int, typer.Option("--seed", help="What the scenes are drawn with.")] = 0,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Write the page there.")
    ] = None,
    limit: Annotated[
        str, typer.Option("--limit", help="A scene that takes longer is left, and named.")
    ] = "60s",
    errors: Annotated[
        bool, typer.Option("--errors", help="Judge stated errors too, by a finer mesh.")
    ] = False,
    found_before: _Found = None,
    jobs: Jobs = 1,
    json_file: JsonFile = None,
) -> None:
    """Press scenes under their plans and with everything on; say what that changes and costs.

    Example: tacauchy-rig study effects --only "by force"
    """
    limit_s = parse_quantity(limit, dimension=Dimension.TIME, field="--limit")
    cases = _drawn(seed, random) if random else _stated()
    chosen = selected(cases, only or [], names=lambda case: (case.name,), kind="scene")
    if list_only:
        for case in chosen:
            say(f"{case.name:22} {case.shows}")
        return
    checks, failed = _found(found_before or [], chosen)
    known = {check.name for check in checks} | (set() if only else failed.keys())
    open_cases = [case for case in chosen if case.name not in known]
    place = {case.name: number for number, case in enumerate(chosen)}
    command = f"tacauchy-rig effects-check{f' --random {random} --seed {seed}' * bool(random)}"
    command += "".join(f" --only {shlex.quote(name)}" for name in only or []) + " --errors" * errors
    command += " --found FILE" * len(found_before or []) + f" --limit {limit}"

    def write() -> None:
        if out is not None and checks:
            write_text(out, _page(checks, failed, f"{command} --out {out}"))
        rows = [check.as_json() for check in checks]
        write_json(json_file, {"scenes": rows, "not_pressed": failed})

    write()
    for case, found in _checked(open_cases, errors=errors, limit_s=limit_s, jobs=jobs):
        if isinstance(found, str):
            failed[case.name] = f"{' '.join(found.split())} ({case.shows})"
            complain(f"{case.name:22} not pressed: {found}")
        else:
            failed.pop(case.name, None)
            insort(checks, found, key=lambda check: place[check.name])
            say(_line(found))
        write()  # After every scene, so that Ctrl-C leaves what was found until then.
    _summarise(checks, failed)
    raise typer.Exit(0 if all(check.passed for check in checks) else 1)


def _checked(
    cases: Sequence[EffectCase], *, errors: bool, limit_s: float, jobs: int
) -> Iterator[tuple[EffectCase, EffectCheck | str]]:
    """Yield the cases as they are done with what was found, or why nothing was."""
    from sim.studies.effects_check.check import check_effects
    from sim.studies.processes import OwnProcess, ProcessFailedError

    free: SimpleQueue[OwnProcess] = SimpleQueue()

    def check(case: EffectCase) -> EffectCheck | str:
        process = free.get()
        try:
            return process.call(partial(check_effects, case, errors=errors), limit_s=limit_s)
        except ProcessFailedError as error:
            return error.message
        finally:
            free.put(process)

    pool = ThreadPoolExecutor(jobs)
    with ExitStack() as running:
        for _ in range(jobs):
            free.put(running.enter_context(OwnProcess()))
        running.callback(pool.shutdown, wait=False, cancel_futures=True)
        futures = {pool.submit(check, case): case for case in cases}
        yield from ((futures[each], each.result()) for each in as_completed(futures))


def _found(
    files: Sequence[Path], cases: Sequence[EffectCase]
) -> tuple[list[EffectCheck], dict[str, str]]:
    """Return what was found before of these cases, in their order, and why some were not pressed.

    Of a case in several files the last counts.
    """
    from sim.studies.effects_check.check import EffectCheck

    rows: dict[str, EffectCheck] = {}
    reasons: dict[str, str] = {}
    for file in files:
        try:
            data = json.loads(file.read_text(encoding="utf-8"))
            scenes, not_pressed = data["scenes"], dict(data["not_pressed"])
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ConfigError(
                f"--found {file}: {error!r}", remedy="give what --json wrote"
            ) from error
        with naming(f"--found {file}"):
            rows |= {check.name: check for check in map(EffectCheck.from_json, scenes)}
        reasons |= not_pressed
    known = [(case, rows[case.name]) for case in cases if case.name in rows]
    strangers = [case.name for case, row in known if row.shows != case.shows]
    strangers += [
        case.name for case in cases if case.shows not in reasons.get(case.name, case.shows)
    ]
    if strangers:
        raise ConfigError(
            f"--found: {', '.join(strangers)} is another scene there",
            remedy="give the same --random and --seed",
        )
    left = {case.name for case in cases} - rows.keys()
    return [row for _, row in known], {name: reasons[name] for name in reasons if name in left}


def _stated() -> Sequence[EffectCase]:
    from sim.studies.effects_check.check import EFFECT_CASES

    return EFFECT_CASES


def _drawn(seed: int, count: int) -> Sequence[EffectCase]:
    from sim.studies.effects_check.check import EffectCase
    from sim.studies.effects_check.drawn import described, drawn_scene

    scenes = [drawn_scene(seed, number) for number in range(count)]
    return [EffectCase(f"{k}", described(scene), scene) for k, scene in enumerate(scenes)]


def _line(check: EffectCheck) -> str:
    verdict = "ok" if check.passed else "MISSED"
    output, share = check.worst
    return (
        f"{check.name:22} {verdict:6} {output.value} {check.differences[output]:9.2e}, "
        f"{share:.0%} of what is allowed, {check.time_ratio:5.1f} times the time with "
        f"{_names(check.added)} on"
    )


def _summarise(checks: Sequence[EffectCheck], failed: dict[str, str]) -> None:
    from sim.studies.effects_check.check import errors_by_output, kept_by_output, time_saved

    if failed:
        say(f"{len(failed)} scenes not pressed: {', '.join(failed)}")
    if not checks:
        return
    for output, (kept, count, worst) in kept_by_output(checks).items():
        say(f"{output.value:10} kept in {kept} of {count} scenes, at worst {worst:.0%} of allowed")
    for output, (inside, count, width) in errors_by_output(checks).items():
        say(f"{output.value:10} errs as stated in {inside} of {count}, {width:.1f} times the error")
    passed = sum(check.passed for check in checks)
    say(f"all outputs kept in {passed} of {len(checks)} scenes")
    say(f"{time_saved(checks):.0%} of the time saved, geometric mean")


def _page(checks: Sequence[EffectCheck], failed: dict[str, str], command: str) -> str:
    from sim.studies.effects_check.check import errors_by_output, kept_by_output, time_saved
    from tacauchy_rig.core.page import page

    facts = {
        "command": command,
        "checks": checks,
        "failed": failed,
        "passed": sum(check.passed for check in checks),
        "outputs": kept_by_output(checks),
        "errors": errors_by_output(checks),
        "saved": time_saved(checks),
        "names": _names,
        "percent": _percent,
    }
    return page("tacauchy_rig.app.cli.studies", "effects.md.jinja", facts)


def _names(effects: Sequence[Effect]) -> str:
    return ", ".join(effect.value for effect in effects) or "nothing"


def _percent(value: float) -> str:
    return f"{float(f'{value * 100:.2g}'):g} %"
