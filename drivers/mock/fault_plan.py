"""Planned failures of mocks, written as for the emulators: ``force_sensor:freeze@12s+2s``."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from drivers.device.faults import Device, Fault, FaultKind, parse_fault
from drivers.mock.world import MockWorld

NAMES = {
    (Device.ROBOT, FaultKind.FREEZE): "arm-frozen",
    (Device.ROBOT, FaultKind.STALL): "arm-stalled",
    (Device.FORCE_SENSOR, FaultKind.FREEZE): "force-stuck",
    (Device.FORCE_SENSOR, FaultKind.STALL): "force-silent",
    (Device.FORCE_SENSOR, FaultKind.DROP): "force-lossy",
    (Device.FORCE_SENSOR, FaultKind.GARBLE): "force-lossy",
    (Device.FORCE_SENSOR, FaultKind.UNPLUG): "force-unplugged",
    (Device.FORCE_SENSOR, FaultKind.SATURATE): "force-saturated",
    (Device.CAMERA, FaultKind.FREEZE): "camera-silent",
    (Device.CAMERA, FaultKind.STALL): "camera-silent",
    (Device.CAMERA, FaultKind.DROP): "camera-silent",
    (Device.CAMERA, FaultKind.SATURATE): "camera-overexposed",
    (Device.CAMERA, FaultKind.UNPLUG): "camera-unplugged",
}
"""Failures that mocks can show, by the name the mock devices look for."""


def plan_faults(
    world: MockWorld, faults: Iterable[str], *, lock_arm: Callable[[], None] | None = None
) -> None:
    """Let ``world`` fail as planned; kinds that only emulators know are passed over.

    Args:
        world: Whose clock the starts are counted on.
        faults: For example ``robot:protective-stop@3s``.
        lock_arm: Called for a protective or an emergency stop.
    """
    for text in faults:
        _plan(world, parse_fault(text), lock_arm)


def _plan(world: MockWorld, fault: Fault, lock_arm: Callable[[], None] | None) -> None:
    stops = (FaultKind.PROTECTIVE_STOP, FaultKind.EMERGENCY_STOP)
    if fault.kind in stops and lock_arm is not None:
        world.when(lambda: world.elapsed_s >= fault.start_s, lock_arm)
        return
    name = NAMES.get((fault.device, fault.kind))
    if name is None:
        return
    end_s = fault.start_s + fault.duration_s
    world.when(lambda: world.elapsed_s >= fault.start_s, lambda: world.faults.add(name))
    world.when(lambda: world.elapsed_s >= end_s, lambda: world.faults.discard(name))
