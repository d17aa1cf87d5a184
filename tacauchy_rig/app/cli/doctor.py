"""``tacauchy-rig doctor``: what is wrong with computer and devices, and what to do about it."""

from __future__ import annotations

from typing import Annotated

import typer

from tacauchy_rig.app.cli.options import ConfigFile, JsonFile, Overrides
from tacauchy_rig.app.cli.output import say, write_json
from tacauchy_rig.core.check_result import CheckResult, CheckStatus

_MARKS = {
    CheckStatus.OK: "ok  ",
    CheckStatus.WARN: "warn",
    CheckStatus.FAIL: "FAIL",
    CheckStatus.SKIP: "skip",
}


def doctor(
    path: ConfigFile = None,
    overrides: Overrides = None,
    json_file: JsonFile = None,
    host_only: Annotated[
        bool, typer.Option("--host-only", help="Ask no device, only this computer.")
    ] = False,
) -> None:
    """Check ports, permissions, rates, disk, replay, robot and clock; nothing moves.

    Example: tacauchy-rig doctor rig.toml
    """
    from tacauchy_rig.core.config.load import load_config

    config = load_config(path, overrides=overrides or ()).config
    from drivers.checks import device_checks
    from tacauchy_rig.app.doctor.host import host_checks
    from tacauchy_rig.app.replay.inputs import check_replay
    from tacauchy_rig.app.session.gel_limits import check_gel
    from tacauchy_rig.core.check_result import checked

    checks = [
        *host_checks(config),
        checked("gel", lambda: check_gel(config)),
        checked("replay", lambda: check_replay(config)),
    ]
    for check in checks:
        _show(check)
    if not host_only:
        for check in device_checks(config):
            checks.append(check)
            _show(check)
    if config.has_emulated_devices:
        say("emulated devices are started by the run itself, so there is nothing to check of them")
    failed = [check for check in checks if check.status is CheckStatus.FAIL]
    say(f"{len(checks)} checks, {len(failed)} failed")
    write_json(json_file, {"checks": checks, "passed": not failed})
    raise typer.Exit(1 if failed else 0)


def _show(check: CheckResult) -> None:
    say(f"{_MARKS[check.status]}  {check.name}: {check.finding}")
    if check.remedy and check.status in (CheckStatus.WARN, CheckStatus.FAIL):
        say(f"      -> {check.remedy}")
