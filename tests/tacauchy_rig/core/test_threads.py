"""One thread for NumPy, unless a user says otherwise."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from tacauchy_rig.core.threads import take_one_thread

VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


@pytest.fixture(autouse=True)
def nothing_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    """A user who has set no variable; what the tests set is taken back."""
    for name in VARIABLES:
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)


def test_openblas_takes_one_and_mkl_is_left_to_the_solver() -> None:
    """Only a process that has siblings also fixes the factor's threads."""
    take_one_thread()
    assert [os.environ.get(name) for name in VARIABLES] == ["1", None, None]
    take_one_thread(solver_too=True)
    assert [os.environ.get(name) for name in VARIABLES] == ["1", None, "1"]


def test_what_a_user_set_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    """OMP_NUM_THREADS is a choice for both libraries."""
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    take_one_thread(solver_too=True)
    assert [os.environ.get(name) for name in VARIABLES] == [None, "2", None]


def test_a_command_has_one_before_numpy_is_there() -> None:
    """The program sets it where it starts; set after the import it would do nothing."""
    script = """
import os, sys
from tacauchy_rig.app.cli import app
assert "numpy" not in sys.modules
sys.argv = ["tacauchy-rig", "--version"]
try:
    app.main()
except SystemExit:
    print(os.environ["OPENBLAS_NUM_THREADS"])
"""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout.split()[-1] == "1"
