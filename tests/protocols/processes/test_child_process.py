"""What a child tells of its end."""

import errno
import faulthandler
import os
import sys
from typing import Never

import pytest

from protocols.processes import child_process
from protocols.processes.ipc import Channel
from tacauchy_rig.core.errors import RigError


@pytest.mark.parametrize(
    ("error", "message", "remedy"),
    [
        (MemoryError(), "control: out of memory", "check where the arm is"),
        (OSError(errno.E2BIG, "too long", "python"), "control: out of memory", "`ulimit -v`"),
        (OSError(errno.ENOMEM, "no memory"), "control: out of memory", "`ulimit -v`"),
        (ValueError("odd"), "control: unforeseen ValueError: odd", "logs/control.log"),
    ],
)
def test_an_error_is_told_even_where_no_log_can_be_written(
    monkeypatch: pytest.MonkeyPatch, error: Exception, message: str, remedy: str
) -> None:
    """A process without memory cannot print a traceback; the supervisor hears of it before."""

    def work(*_: object) -> Never:
        raise error

    def log(*_: object, **__: object) -> Never:
        raise MemoryError

    ours, theirs = Channel.pair()
    monkeypatch.setattr(faulthandler, "enable", lambda: None)
    monkeypatch.setattr(sys, "argv", ["child", str(os.dup(theirs.fileno()))])
    monkeypatch.setattr(child_process, "_receive_job", lambda *_: None)
    monkeypatch.setattr(child_process.logger, "critical", log)
    with pytest.raises(MemoryError):
        child_process.run_child("control", work)
    (told,) = ours.receive()
    assert isinstance(told, RigError)
    assert told.message == message
    assert remedy in told.remedy
    ours.close()
    theirs.close()
