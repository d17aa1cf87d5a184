"""Work in processes of its own, one thread for NumPy, and long work that says what it does."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Event

import psutil
import pytest

from tacauchy_rig.core import time_limit_and_progress
from tacauchy_rig.core.errors import ConfigError, TimeLimitError
from tacauchy_rig.core.parallel import (
    IsolatedWorker,
    ProcessFailedError,
    parallel_map,
    worker_process,
)
from tacauchy_rig.core.threads import take_one_thread
from tacauchy_rig.core.time_limit_and_progress import (
    Remaining,
    check_time,
    doing,
    time_left_s,
    time_limit,
    told,
)


def _process_of(name: str) -> tuple[str, int]:
    return name, os.getpid()


def _refuse(name: str) -> str:
    raise ConfigError(f"{name} is refused", remedy="do not ask")


def test_results_keep_their_order_and_come_from_other_processes() -> None:
    """Three names by two jobs: in order, none from this process."""
    found = list(parallel_map(_process_of, ["c", "a", "b"], jobs=2))
    assert [name for name, _ in found] == ["c", "a", "b"]
    assert all(name == told for name, (told, _) in found)
    assert os.getpid() not in {process for _, (_, process) in found}


def test_one_process_works_beside_this_one_and_its_errors_come_back() -> None:
    """It is another process, the same for all work, and what is raised there is raised here."""
    with worker_process() as other:
        (_, first), (_, second) = (other.submit(_process_of, name).result() for name in "ab")
        refused = other.submit(_refuse, "c")
        with pytest.raises(ConfigError, match="c is refused"):
            refused.result()
    assert first == second != os.getpid()


def _wait_long(_name: str) -> None:
    time.sleep(600.0)


def _interrupted_with_work(found: list[psutil.Process]) -> None:
    with worker_process() as other:
        _, number = other.submit(_process_of, "a").result()
        found.append(psutil.Process(number))
        other.submit(_wait_long, "b")
        raise KeyboardInterrupt


def test_a_process_beside_this_one_ends_with_an_error_here() -> None:
    """An interrupt does not wait for what was begun, which would take ten minutes."""
    found: list[psutil.Process] = []
    with pytest.raises(KeyboardInterrupt):
        _interrupted_with_work(found)
    _, alive = psutil.wait_procs(found, timeout=30.0)
    assert not alive


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


def test_one_job_stays_in_this_process() -> None:
    """One at a time needs no other process."""
    found = list(parallel_map(_process_of, ["a", "b"], jobs=1))
    assert {process for _, (_, process) in found} == {os.getpid()}


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_error_arrives_as_it_was_raised(jobs: int) -> None:
    """The error of a measurement keeps its text and its remedy on the way back."""
    with pytest.raises(ConfigError, match="a is refused") as caught:
        list(parallel_map(_refuse, ["a", "b"], jobs=jobs))
    assert caught.value.remedy == "do not ask"


_LONG = """
import signal
from tests.tacauchy_rig.core.test_parallel import _stay
from tacauchy_rig.core.parallel import parallel_map

if __name__ == "__main__":
    # A shell's background process, and what it begins, are born deaf to Ctrl-C.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    list(parallel_map(_stay, {names!r}, jobs=2))
"""


@contextmanager
def _long_command(folder: Path, names: list[str]) -> Iterator[subprocess.Popen[bytes]]:
    """Run the command in a session of its own; nothing of it is left, whatever a test finds."""
    script = folder / "long.py"
    script.write_text(_LONG.format(names=names), encoding="utf-8")
    root = Path(__file__).parents[3]
    command = subprocess.Popen(
        [sys.executable, str(script)],
        env=os.environ | {"PYTHONPATH": str(root)},
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        yield command
    finally:
        with suppress(ProcessLookupError):
            os.killpg(command.pid, signal.SIGKILL)
        command.wait()


def _stay(name: str) -> None:
    Path(name).write_text(str(os.getpid()), encoding="utf-8")
    time.sleep(60.0)


def test_measurements_end_with_a_killed_command(tmp_path: Path) -> None:
    """SIGKILL leaves no process that goes on measuring."""
    names = [str(tmp_path / "a"), str(tmp_path / "b")]
    with _long_command(tmp_path, names) as command:
        assert _comes_true(lambda: all(map(_is_written, names))), "nothing was measured"
        command.kill()
    measuring = [int(Path(name).read_text()) for name in names]
    assert _comes_true(lambda: not any(map(psutil.pid_exists, measuring)))


def test_ctrl_c_ends_what_runs_and_begins_nothing_more(tmp_path: Path) -> None:
    """A terminal sends it to all of them; what was still to be measured is left."""
    names = [str(tmp_path / name) for name in "abcdefgh"]
    with _long_command(tmp_path, names) as command:
        assert _comes_true(lambda: all(map(_is_written, names[:2]))), "nothing was measured"
        os.killpg(command.pid, signal.SIGINT)
        assert command.wait(timeout=30.0) != 0
    assert not any(map(_is_written, names[2:]))


def _is_written(name: str) -> bool:
    return Path(name).exists() and Path(name).read_text() != ""


def _comes_true(holds: Callable[[], bool]) -> bool:
    for _ in range(600):
        if holds():
            return True
        time.sleep(0.05)
    return False


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


def test_the_nearest_limit_counts_and_is_named() -> None:
    """Of two limits the shorter, also before something new is begun; none is left outside."""
    with time_limit(60.0), time_limit(1e-9):
        assert time_left_s() <= 1e-9
        with pytest.raises(TimeLimitError, match="limit of 1e-09 s") as caught, doing("pressing"):
            pass
    assert caught.value.remedy
    check_time()


def test_the_error_names_the_step_and_how_far_it_was() -> None:
    """Both, from the outermost on."""
    with doing("press"), doing("pressing to 1 N") as at:
        at("0.2 mm, 0.5 N")
        with time_limit(0.0), pytest.raises(TimeLimitError, match="press: pressing to 1 N: 0"):
            check_time()


def test_what_takes_long_is_told_and_idle_time_is_not() -> None:
    """Another thread tells of a step; between steps it says nothing."""
    said, heard = [], Event()

    def say(text: str) -> None:
        said.append(text)
        heard.set()

    with told(say, silent_s=0.02):
        time.sleep(0.06)
        assert said == []
        with doing("meshing"):
            assert heard.wait(30.0)
    assert said[0].endswith("s: meshing")


def test_what_is_left_follows_how_fast_it_went(monkeypatch: pytest.MonkeyPatch) -> None:
    """At first by the processors that are free, then by how fast the first parts went."""
    now, free = [0.0], [2.0]
    monkeypatch.setattr(time_limit_and_progress.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(time_limit_and_progress, "_processors", lambda count: min(count, free[0]))
    left = Remaining(200.0, jobs=2)
    left.add(10.0, alone=True)
    assert left.seconds() == pytest.approx(110.0)
    now[0] = 30.0
    left.spend(10.0, alone=True)  # one process took thrice as long: so will two
    assert left.seconds() == pytest.approx(300.0, rel=0.2)
    for _ in range(10):
        now[0] += 15.0
        left.spend(10.0)
    assert left.seconds() == pytest.approx(150.0, rel=0.15)
    free[0] = 0.5
    assert str(Remaining(150.0, jobs=2)) == "about 5 min left"


def test_busy_programs_are_seen_at_once() -> None:
    """The load average would tell of a busy loop a minute later, and as long after its end."""
    busy = ["timeout", "3", "sh", "-c", "while :; do :; done"]
    loops = [subprocess.Popen(busy) for _ in range(4 * (os.cpu_count() or 1))]
    assert Remaining(100.0).seconds() > 200.0
    for loop in loops:
        loop.wait()
