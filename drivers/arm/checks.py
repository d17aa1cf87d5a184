"""Checks of the arm: who answers, is it ready, is it near home. Nothing moves or changes."""

from __future__ import annotations

import math
from collections.abc import Sequence

from drivers.arm.interface import Arm
from drivers.arm.ur5_probe import ControllerReport, probe_controller, require_ready
from tacauchy_rig.core.check_result import CheckResult, failed, judged, passed, skipped
from tacauchy_rig.core.config.model import RigConfig
from tacauchy_rig.core.errors import DeviceError
from tacauchy_rig.core.registry import Kind, load


def robot_checks(config: RigConfig) -> list[CheckResult]:
    """Return ``robot.controller``, ``robot.ready`` and ``robot.home``."""
    robot = config.robot
    if robot.driver != "ur5":
        return _connected_checks(config)
    try:
        report = probe_controller(robot.host, timeout_s=robot.connect_timeout)
    except DeviceError as error:
        later = [skipped(name, "no controller answers") for name in ("robot.ready", "robot.home")]
        return [failed("robot.controller", error), *later]
    finding = (
        f"{report.model.value}, software {report.version_text}, serial number "
        f"{report.serial or 'unknown'}, answered everything in {report.probe_s * 1e3:.0f} ms"
    )
    controller = passed("robot.controller", finding, value=report.probe_s * 1e3, unit="ms")
    return [controller, _ready_check(config, report), _home_check(config, report.pose)]


def _connected_checks(config: RigConfig) -> list[CheckResult]:
    """Connect to an arm of another package, which looks for itself whether it is ready."""
    arm: Arm = load(Kind.ARM, config.robot.driver)(config)
    try:
        identity = arm.connect()
        position = arm.state().pose.position
    except DeviceError as error:
        return [failed("robot.controller", error), skipped("robot.home", "no controller answers")]
    finally:
        arm.close()
    answers = passed("robot.controller", f"{identity.model} at {identity.address}")
    return [answers, _home_check(config, position)]


def _ready_check(config: RigConfig, report: ControllerReport) -> CheckResult:
    try:
        require_ready(report, model=config.robot.model)
    except DeviceError as error:
        return failed("robot.ready", error)
    return passed("robot.ready", "powered, in remote control, free, no safety stop")


def _home_check(config: RigConfig, pose: Sequence[float]) -> CheckResult:
    distance_m = math.dist(pose[:3], config.robot.home)
    position = ", ".join(f"{value * 1e3:.1f}" for value in pose[:3])
    finding = f"the tip is at ({position}) mm, {distance_m * 1e3:.1f} mm from home"
    return judged(
        "robot.home",
        finding,
        is_good=distance_m <= config.workspace.home_radius,
        value=distance_m * 1e3,
        unit="mm",
        remedy=f"jog the tip to within {config.workspace.home_radius * 1e3:g} mm of robot.home, or "
        "correct robot.home and the pendant's tool centre point",
    )
