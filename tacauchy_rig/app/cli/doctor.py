"""``doctor`` and ``check-press``: faults of computer, devices and gel, and their remedies."""

from pathlib import Path

from tacauchy_rig.app.cli.output import ConfigFile, Found, Overrides, say
from tacauchy_rig.core.doctor_check import CheckResult, CheckStatus


def doctor(
    path: ConfigFile = None, *, overrides: Overrides = None, host_only: bool = False
) -> Found:
    """Check ports, permissions, rates, disk, replay, robot and clock; nothing moves.

    Example: tacauchy-rig doctor rig.toml

    Args:
        host_only: Check only this computer, no device.
    """
    from tacauchy_rig.core.config.load import load_config

    config = load_config(path, overrides=overrides or ()).config
    from drivers.device_checks import device_checks
    from tacauchy_rig.app.host_checks import host_checks
    from tacauchy_rig.app.replay.simulator_inputs import check_gel, check_replay
    from tacauchy_rig.core.doctor_check import checked

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
    return Found({"checks": checks, "passed": not failed}, passed=not failed)


def _show(check: CheckResult) -> None:
    mark = "FAIL" if check.status is CheckStatus.FAIL else check.status
    say(f"{mark:4}  {check.name}: {check.finding}")
    if check.remedy and check.status in (CheckStatus.WARN, CheckStatus.FAIL):
        say(f"      -> {check.remedy}")


USUAL_N = 2.0
"""Force of the press: enough to measure modulus and image, and harmless to any gel."""


def check_press(before: Path, path: Path | None = None, *, overrides: Overrides = None) -> Found:
    """Press once and report whether the sensor has changed since an earlier run.

    Example: tacauchy-rig check-press runs/20261101-090000-first rig.toml

    Args:
        before (RUN): An earlier run of this sensor and tool.
        path (CONFIG|RUN): A rig.toml to press with, or a later run; the dry run's if absent.
    """
    from tacauchy_rig.app.cli.run_and_resume import recorded
    from tacauchy_rig.app.gel_health import Advice, compare_runs, nearest_force_n
    from tacauchy_rig.app.replay.open_run import open_run

    known = open_run(before)
    target_n = nearest_force_n(known, USUAL_N)
    one = (f'protocol.force_targets=["{target_n:g} N"]', 'run.name="check-press"')
    folder = recorded(path, [*(overrides or ()), *one]).paths.root
    state = compare_runs(known, open_run(folder))
    for each in state.changes:
        number, unit = (each.value, f" {each.unit}") if each.unit else (100.0 * each.value, " %")
        scale = 1.0 if each.unit else 100.0
        say(
            f"{each.name:22} {number:+.2f} +- {scale * each.uncertainty:.2f}{unit} "
            f"(limit {scale * each.limit:g}{unit}){'  <-' if each.counts else ''}"
        )
    say(f"{state.advice.value}: {state.reason}")
    content = {"before": str(before), "now": str(folder), "state": state}
    return Found(content, passed=state.advice is Advice.KEEP)
