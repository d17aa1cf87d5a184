"""A process of its own."""

from __future__ import annotations

import os

import psutil
import pytest

from tacauchy_rig.core.parallel import IsolatedWorker, ProcessFailedError


def test_one_process_takes_every_call_until_it_ends() -> None:
    """What was loaded stays loaded; after a crash another process goes on."""
    with IsolatedWorker() as process:
        first, again = (process.call(os.getpid, limit_s=60.0) for _ in range(2))
        with pytest.raises(ProcessFailedError, match="ended with status -6 and no result"):
            process.call(os.abort, limit_s=60.0)
        other = process.call(os.getpid, limit_s=60.0)
    assert first == again != os.getpid()
    assert other not in {first, os.getpid()}
    assert not psutil.pid_exists(other)
