"""A folder of runs: two with a report, an aborted one and a damaged one."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tacauchy_rig.core.run import Outcome
from tests.tacauchy_rig.app.results.made_runs import NAMES, Client, made_run, reported, served


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    """The folder."""
    root = tmp_path / "runs"
    root.mkdir()
    first = made_run(root, NAMES[0], force_n=1.25)
    reported(first, modulus=1.0)
    reported(made_run(root, NAMES[1], force_n=1.30), modulus=1.1)
    made_run(root, NAMES[2], force_n=0.2, outcome=Outcome.ABORTED)
    damaged = made_run(root, NAMES[3], force_n=1.2)
    (damaged / "run.json").write_text("{", "utf-8")
    (root / "notes").mkdir()
    return root


@pytest.fixture
def client(runs: Path) -> Iterator[Client]:
    """A browser at its page."""
    with served(runs) as client:
        yield client
