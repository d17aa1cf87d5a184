"""What an operator hears of kernels that are compiled."""

from __future__ import annotations

import logging

import pytest

from tacauchy_rig.app.cli.compilation import compilation_told

SOURCE = logging.getLogger("sim.device.compiled")


def test_the_first_is_announced_and_the_sum_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    """One line when it begins to matter, one in the end, nothing on standard output."""
    with compilation_told():
        for seconds in (30.0, 7.6):
            SOURCE.info("compiled", extra={"compiled_s": seconds})
    told = capsys.readouterr()
    assert not told.out
    assert told.err.splitlines() == [
        "compiling kernels once for this computer; later presses find them",
        "compiling kernels once: 38 s",
    ]


def test_nothing_is_said_where_nothing_is_compiled(capsys: pytest.CaptureFixture[str]) -> None:
    """Kernels that are found need no words."""
    with compilation_told():
        pass
    SOURCE.info("compiled", extra={"compiled_s": 1.0})
    assert not capsys.readouterr().err
