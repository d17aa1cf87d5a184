"""A log that nothing depends on."""

from __future__ import annotations

import json
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from tacauchy_rig.core.store.line_log import LineLog


@dataclass(frozen=True)
class _Line:
    number: int
    force_n: float | None


def test_a_second_writer_goes_on_after_the_lines_that_are_there(tmp_path: Path) -> None:
    """Each line is JSON."""
    path = tmp_path / "twin.jsonl"
    for number in (1, 2):
        with closing(LineLog(path)) as log:
            log.append(_Line(number, None))
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    assert lines == [{"number": 1, "force_n": None}, {"number": 2, "force_n": None}]


def test_a_disk_that_refuses_costs_the_lines_and_no_more(tmp_path: Path) -> None:
    """A full disk, and a folder that is not there."""
    for path in (Path("/dev/full"), tmp_path / "absent" / "twin.jsonl"):
        with closing(LineLog(path)) as log:
            log.append(_Line(1, 0.5))
            log.append(_Line(2, 0.5))
