"""Emulators ask to be run when they are due, and do without where they may not."""

from __future__ import annotations

import os

import pytest

from drivers.emulators.process import keep_time


@pytest.mark.parametrize("mostly_sleeps", [True, False])
def test_a_refused_priority_is_no_error(monkeypatch, mostly_sleeps):
    """A user without the right to a higher priority emulates all the same."""
    asked = []

    def refuse(*arguments):
        asked.append(arguments)
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    monkeypatch.setattr(os, "nice", refuse)
    keep_time(mostly_sleeps=mostly_sleeps)
    assert len(asked) == 1
    assert asked[0][0] == (0 if mostly_sleeps else -10)
