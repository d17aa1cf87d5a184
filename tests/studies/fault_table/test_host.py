"""Trouble of the computer reaches the program that is to have it, and no other."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from tests.studies.fault_table.cases import HostTrouble, Trouble

HOUR_S = 3600.0
# Answers each line of its input: seconds of both clocks since the first line, and what writing
# below the disk and beside it came to, by a file that was open before and by a new one.
PROGRAM = """
import datetime, sys, time
from pathlib import Path

disk = Path(sys.argv[1])
kept = (disk / "kept").open("wb", buffering=0)

def tried(write):
    try:
        write()
    except OSError as error:
        return error.strerror.replace(" ", "_")
    return "written"

for _ in sys.stdin:
    print(
        time.time(), datetime.datetime.now().timestamp(), time.monotonic(),
        tried(lambda: kept.write(b"x")),
        tried(lambda: (disk / "new").write_text("x")),
        tried(lambda: (disk / str(time.monotonic_ns())).mkdir()),
        tried(lambda: (disk / "kept").replace(disk / "kept")),
        tried(lambda: (disk.parent / "elsewhere").write_text("x")),
        flush=True,
    )
"""


class Program:
    """A program with trouble."""

    def __init__(self, trouble: HostTrouble, disk: Path) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", PROGRAM, str(disk)],
            env=trouble.environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def look(self) -> tuple[list[float], list[str]]:
        """Return (time, date, monotonic clock) [s] and what became of five ways to write."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        words = self._process.stdout.readline().split()
        return [float(word) for word in words[:3]], words[3:]

    def close(self) -> None:
        """End it."""
        self._process.communicate()


@pytest.fixture
def trouble(tmp_path: Path) -> HostTrouble:
    """Return trouble that is not on yet."""
    (tmp_path / "disk").mkdir()
    return HostTrouble(tmp_path / "host", disk=tmp_path / "disk")


@pytest.fixture
def program(trouble: HostTrouble, tmp_path: Path) -> Iterator[Program]:
    """Return a program that will have it."""
    with closing(Program(trouble, tmp_path / "disk")) as started:
        yield started


@pytest.mark.parametrize(
    ("kind", "jump_s"), [(Trouble.CLOCK_BACK, -HOUR_S), (Trouble.CLOCK_FORWARD, HOUR_S)]
)
def test_the_wall_clock_jumps_and_the_monotonic_one_does_not(
    trouble: HostTrouble, program: Program, kind: Trouble, jump_s: float
) -> None:
    """An hour, in time and date; and back when it is over."""
    before, _ = program.look()
    trouble.begin(kind)
    during, written = program.look()
    trouble.end()
    after, _ = program.look()
    passed_s = during[2] - before[2]
    assert 0.0 <= passed_s < 60.0
    assert during[0] - before[0] == pytest.approx(jump_s + passed_s, abs=0.1)
    assert during[1] - before[1] == pytest.approx(jump_s + passed_s, abs=0.1)
    assert after[0] - before[0] == pytest.approx(after[2] - before[2], abs=0.1)
    assert set(written) == {"written"}


@pytest.mark.parametrize(
    ("kind", "told"),
    [
        (Trouble.READ_ONLY, 4 * ["Read-only_file_system"]),
        # No byte more, no new file or folder; renaming needs no room.
        (Trouble.DISK_FULL, [*3 * ["No_space_left_on_device"], "written"]),
    ],
)
def test_a_disk_takes_nothing_under_an_open_file(
    trouble: HostTrouble, program: Program, tmp_path: Path, kind: Trouble, told: list[str]
) -> None:
    """What lies beside it is not concerned, nor another program."""
    assert set(program.look()[1]) == {"written"}
    trouble.begin(kind)
    assert program.look()[1] == [*told, "written"]
    (tmp_path / "disk" / "ours").write_text("this program has no trouble", encoding="utf-8")
    trouble.end()
    assert set(program.look()[1]) == {"written"}
