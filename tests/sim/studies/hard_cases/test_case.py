"""A case is measured in a process of its own, whatever becomes of that process."""

from __future__ import annotations

import importlib
import time
from pathlib import Path
from types import ModuleType

import pytest

from sim.studies.hard_cases.case import CaseResult, HardCase, observe

BAD_ROWS = """
import os, subprocess, sys, time
from pathlib import Path
from sim.studies.hard_cases.case import Outcome
from tacauchy_rig.core.errors import ConvergenceError

def measures():
    return Outcome(passed=True, measured={"answer": 42})

def misses():
    return Outcome(passed=False, measured={"answer": 41})

def raises():
    raise ConvergenceError("the press stopped at 3.1 mm", remedy="press less")

def crashes():
    os.abort()

def hangs():
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
    Path(__file__).with_name("pid").write_text(str(child.pid))
    time.sleep(600)
"""


@pytest.fixture
def rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Rows that go wrong in every way, in a module that a child process can import."""
    (tmp_path / "bad_rows.py").write_text(BAD_ROWS)
    monkeypatch.syspath_prepend(tmp_path)
    return importlib.reload(importlib.import_module("bad_rows"))


def seen(rows: ModuleType, name: str, *, limit_s: float = 60.0) -> CaseResult:
    """Observe one of the rows."""
    case = HardCase(
        number=99, name=name, criterion="it ends", measure=getattr(rows, name), limit_s=limit_s
    )
    return observe(case)


def test_numbers_come_back(rows: ModuleType) -> None:
    """What was measured is told, with the verdict of the case."""
    good, bad = seen(rows, "measures"), seen(rows, "misses")
    assert (good.passed, good.measured, good.failure) == (True, {"answer": 42}, "")
    assert (bad.passed, bad.measured, bad.failure) == (False, {"answer": 41}, "")


def test_a_row_that_raises_fails_with_its_error(rows: ModuleType) -> None:
    """The error's words are the failure."""
    result = seen(rows, "raises")
    assert not result.passed
    assert result.failure.startswith("ConvergenceError: the press stopped at 3.1 mm")


def test_a_row_that_crashes_fails_with_its_status(rows: ModuleType) -> None:
    """SIGABRT ends that row alone."""
    result = seen(rows, "crashes")
    assert not result.passed
    assert "ended with status -6" in result.failure


def test_a_row_over_its_limit_is_ended_with_its_children(rows: ModuleType, tmp_path: Path) -> None:
    """Neither the row nor what it started is left."""
    result = seen(rows, "hangs", limit_s=8.0)
    assert not result.passed
    assert result.failure == "not done after 8 s"
    status = Path(f"/proc/{(tmp_path / 'pid').read_text()}/status")
    end_s = time.monotonic() + 10.0
    while _lives(status) and time.monotonic() < end_s:
        time.sleep(0.05)
    assert not _lives(status)


def _lives(status: Path) -> bool:
    try:
        return "(zombie)" not in status.read_text("utf-8")
    except (FileNotFoundError, ProcessLookupError):
        return False
