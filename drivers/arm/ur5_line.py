"""A straight move that the controller drives by itself while the program watches."""

from __future__ import annotations

import time
from typing import Any

from drivers.arm.ur5_link import UrLink
from tacauchy_rig.run import Vector6

_BEGINS_S = 0.5
_POLL_S = 0.002


class LineMove:
    """One asynchronous moveL, followed through the controller's numbers for such operations.

    Args:
        link: The arm's connection.
    """

    def __init__(self, link: UrLink) -> None:
        self._link = link
        self._operation_before = -1
        self._start_s = 0.0

    def start(self, target: Vector6, *, speed: float, acceleration: float) -> None:
        """Send the move [m, rad; m/s; m/s^2] and return at once.

        Raises:
            DeviceError: The controller refused.
        """
        _, self._operation_before = self._link.call("reading progress", _progress)
        self._start_s = time.monotonic()
        self._link.command(
            "starting a move", lambda c: c.moveL(list(target), speed, acceleration, True)
        )

    def is_running(self) -> bool:
        """Return True until the move has ended.

        Raises:
            DeviceError: The move never began, or the arm is lost.
        """
        running, operation = self._link.call("reading progress", _progress)
        if running or operation != self._operation_before:
            return running
        if time.monotonic() - self._start_s > _BEGINS_S:
            raise self._link.health.lose("the move never began", "read the pendant's message")
        return True

    def stop(self, deceleration: float, *, deadline_s: float) -> None:
        """Brake the tip at ``deceleration`` [m/s^2] and wait for it, at most ``deadline_s`` [s].

        Raises:
            DeviceError: The controller did not answer.
        """
        end_s = time.monotonic() + deadline_s
        # Only the asynchronous form brakes the tip at [m/s^2]; the other one is a stopj.
        self._link.call("stopping", lambda c: c.stopL(deceleration, True), deadline_s=deadline_s)
        while (left_s := end_s - time.monotonic()) > 0.0:
            running, _ = self._link.call("reading progress", _progress, deadline_s=left_s + _POLL_S)
            if not running:
                return
            time.sleep(_POLL_S)


def _progress(control: Any) -> tuple[bool, int]:
    """Return (whether an asynchronous operation runs, its number)."""
    status = control.getAsyncOperationProgressEx()
    return bool(status.isAsyncOperationRunning()), int(status.operationId())
