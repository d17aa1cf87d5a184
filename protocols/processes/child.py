"""What every child process does first and last."""

from __future__ import annotations

import errno
import faulthandler
import logging
import os
import signal
import sys
import time
from collections.abc import Callable

from protocols.guard.abort import SIGNALS
from protocols.processes.channel import Channel
from protocols.processes.messages import Failed, Job
from tacauchy_rig.core.errors import DeviceError, RigError

logger = logging.getLogger(__name__)

JOB_TIMEOUT_S = 10.0


def run_child(name: str, work: Callable[[Job, Channel], None]) -> int:
    """Take the job from the supervisor and do it; return the exit status.

    Errors go to the supervisor as plain words, and with their traceback to the log (stderr).
    """
    faulthandler.enable()
    logging.basicConfig(
        stream=sys.stderr, level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s"
    )
    supervisor = Channel.inherited(int(sys.argv[1]))
    try:
        work(_receive_job(name, supervisor), supervisor)
    except RigError as error:
        logger.error("%s", error)
        supervisor.send(Failed.because(error))
        return error.exit_code
    except Exception as error:
        supervisor.send(_unforeseen(name, error))  # first: without memory the log may fail
        logger.critical("unforeseen", exc_info=error)
        return 2
    return 0


def _unforeseen(name: str, error: Exception) -> Failed:
    # Where a program cannot get the memory of its arguments, the kernel says E2BIG.
    refused = isinstance(error, OSError) and error.errno in (errno.ENOMEM, errno.E2BIG)
    if refused or isinstance(error, MemoryError):
        return Failed(
            message=f"{name}: out of memory",
            remedy="look where the arm stands; end other programs or lift `ulimit -v`, then "
            "`tacauchy-rig resume` continues",
        )
    return Failed(
        message=f"{name}: unforeseen {type(error).__name__}: {error}",
        remedy=f"read logs/{name}.log in the run folder",
    )


def ask_for_priority(niceness: int) -> None:
    """Ask the kernel to prefer this process; without the right to it, say so and go on.

    Not a real-time class: ur_rtde polls in a loop, and a real-time thread that polls can starve
    whatever it waits for on the same core (seen as commands without an answer for a second).
    """
    try:
        os.nice(niceness)
    except PermissionError:
        logger.info("no right to a higher priority; `ulimit -e 40` would give it")


def ignore_signals() -> None:
    """Leave signals meant for the run to the processes that can act on them."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def _receive_job(name: str, supervisor: Channel) -> Job:
    deadline = time.monotonic() + JOB_TIMEOUT_S
    while time.monotonic() < deadline and not supervisor.closed:
        supervisor.wait(0.1)
        # One at a time: an order that follows the job is for whoever does the job.
        for message in supervisor.receive(limit=1):
            if isinstance(message, Job):
                return message
    raise DeviceError(f"{name}: no job from the supervisor within {JOB_TIMEOUT_S:g} s")
