"""A log that nothing depends on."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from tacauchy_rig.core.store.line_log import LineLog, read_log


@dataclass(frozen=True)
class _Line:
    number: int
    force_n: float | None


def test_lines_are_read_back_and_a_torn_one_left_out(tmp_path: Path) -> None:
    """A second writer goes on after the lines that are there."""
    path = tmp_path / "twin.jsonl"
    assert read_log(path) == []
    for number in (1, 2):
        with closing(LineLog(path)) as log:
            log.append(_Line(number, None))
    with path.open("a") as file:
        file.write('{"number": 3, "for')
    assert read_log(path) == [{"number": 1, "force_n": None}, {"number": 2, "force_n": None}]


def test_a_disk_that_refuses_costs_the_lines_and_no_more(tmp_path: Path) -> None:
    """A full disk, and a folder that is not there."""
    for path in (Path("/dev/full"), tmp_path / "absent" / "twin.jsonl"):
        with closing(LineLog(path)) as log:
            log.append(_Line(1, 0.5))
            log.append(_Line(2, 0.5))
