"""Some kinds of the study "hostile-runs" against the commands that read most."""

from pathlib import Path

import pytest

from tests.studies.hostile_runs.command import observe, recorded

READERS = ("recover", "export csv", "serve")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that nobody touched."""
    return recorded(tmp_path_factory.mktemp("runs"), is_large=False)


@pytest.mark.parametrize(
    "kind",
    [
        "link: report/report.html",
        "linked folder: report",
        "pipe: report/summary.json",
        "terabyte: trials/01/attempt-1/recording.mcap",
        "name: bytes that are no text",
        "name: a digit that is no number",
        "report/summary.json: nested 100,000 deep",
        "recording: stamps of 64 bits",
        "recording: /force of garbage",
    ],
)
def test_a_hostile_run_does_no_harm(run: Path, kind: str) -> None:
    """Nothing outside changes, nothing hangs, and the run beside it is shown."""
    seen = observe(kind, run=run, seed=1, only=READERS)
    assert [each for each in seen if each.failure] == []
