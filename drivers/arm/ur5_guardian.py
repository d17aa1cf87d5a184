"""End this process when a native call does not come back, whatever the call holds.

ur_rtde's constructors and destructors hold Python's interpreter lock: while one hangs, no Python
thread and no Python signal handler of the process runs, so a deadline inside it cannot work. A
tiny second process can. It holds the reading end of a pipe: told that the call returned, it
ends; told nothing until the deadline, it says why on stderr and kills this process. That is
safe for the arm, whose watchdog stops it once nobody feeds the controller.

An alarm signal with its default action would also end the process, but mutely, and it would
fight with anyone else who uses SIGALRM. Forking instead of starting a fresh interpreter would
copy locks that native threads hold.

Run as a script, this file is the second process; it imports nothing but the standard library.
"""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys

_RELEASE_S = 1.0


class Guardian:
    """A context: if its body takes longer than ``timeout_s`` [s], this process is killed.

    Args:
        activity: What hangs, for the message on stderr.
    """

    def __init__(self, activity: str, *, timeout_s: float) -> None:
        self._activity = activity
        self._timeout_s = timeout_s

    def __enter__(self) -> Guardian:
        self._process = subprocess.Popen(
            [
                *(sys.executable, "-I", "-S", __file__),
                *(str(os.getpid()), str(self._timeout_s), self._activity),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
        )
        return self

    def __exit__(self, *_: object) -> None:
        if self._process.stdin is not None:
            self._process.stdin.close()
        try:
            self._process.wait(_RELEASE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def guard(process_id: int, timeout_s: float, activity: str) -> int:
    """Wait for the pipe on stdin to close; kill ``process_id`` if it does not in time."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    ready, _, _ = select.select([sys.stdin], [], [], timeout_s)
    if ready or os.getppid() != process_id:
        return 0
    sys.stderr.write(
        f"{activity}: no answer within {timeout_s:g} s, so this process is ended\n"
        "  -> look at the device, then start again; an arm in motion is stopped by its watchdog\n"
    )
    sys.stderr.flush()
    os.kill(process_id, signal.SIGKILL)
    return 1


if __name__ == "__main__":
    sys.exit(guard(int(sys.argv[1]), float(sys.argv[2]), sys.argv[3]))
