"""How an emulated device keeps time although it shares a computer with the program under test."""

from __future__ import annotations

import logging
import os

_logger = logging.getLogger(__name__)

_REAL_TIME_PRIORITY = 1
_NICENESS = -10


def keep_time(*, mostly_sleeps: bool) -> None:
    """Ask the kernel to run this process when it is due; without the right to it, go on.

    A real device is not slowed down by the computer that it serves.

    Args:
        mostly_sleeps: Whether the whole process works for a small part of its time, so that it
            may go ahead of all ordinary processes; otherwise it is only preferred to them.
    """
    try:
        if mostly_sleeps:
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(_REAL_TIME_PRIORITY))
        else:
            os.nice(_NICENESS)
    except PermissionError:
        _logger.info("no right to a higher priority; `ulimit -r 1; ulimit -e 40` would give it")
