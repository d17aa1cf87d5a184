"""A person's wish to stop: counted, and from signals, keys and the loss of the terminal."""

import os
import pty
import signal
import termios
import time

import pytest

from protocols.guard.abort import Abort, AbortWatch
from tacauchy_rig.core.run import Outcome


@pytest.mark.parametrize("phase", ["preflight", "air-press", "tare", "search", "press", "dwell"])
def test_an_abort_stops_the_arm_in_every_phase(laboratory, phase):
    """The outcome is aborted, nothing moves any more and the gel is left."""
    lab = laboratory('protocol.force_targets=["3 N"]')
    lab.when_phase(phase, lambda: lab.abort.request("a key was pressed"), delay_s=0.2)
    result = lab.run()
    assert result.outcome is Outcome.ABORTED
    assert result.reason.startswith("aborted: a key was pressed")
    assert all(record.outcome is Outcome.ABORTED for record in lab.sink.records)
    lab.assert_rests()
    assert lab.world.force_n == 0.0


def test_a_second_abort_holds_the_arm_where_it_is(laboratory):
    """Asked again during the retract, the arm stays, even in the gel."""
    lab = laboratory('protocol.force_targets=["4 N"]')
    lab.when_phase("dwell", lambda: lab.abort.request("first"), delay_s=0.2)
    lab.when_phase("dwell", lambda: lab.abort.request("second"), delay_s=0.8)
    result = lab.run()
    assert "holds where it is" in result.reason
    lab.assert_rests()
    assert lab.world.force_n > 0.1


def test_one_wish_that_arrives_several_times_is_one():
    """Ctrl-C reaches the supervisor and control: within a moment it is the same wish."""
    abort = Abort()
    heard = []
    abort.on_request(heard.append)
    abort.request("Ctrl-C")
    abort.request("Ctrl-C")
    assert (abort.count, abort.reason, heard) == (1, "Ctrl-C", ["Ctrl-C"])


def wait_for(condition, *, timeout_s=5.0):
    """Wait until ``condition`` holds; fail the test after ``timeout_s``."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, "it never happened"
        time.sleep(0.01)


@pytest.fixture
def terminal():
    """Return both ends of a pseudo-terminal."""
    master, slave = pty.openpty()
    yield master, slave
    for descriptor in (master, slave):
        try:
            os.close(descriptor)
        except OSError:
            continue


@pytest.mark.parametrize(
    ("number", "reason"),
    [
        (signal.SIGINT, "Ctrl-C"),
        (signal.SIGTERM, "SIGTERM"),
        (signal.SIGHUP, "the terminal was lost"),
        (signal.SIGTSTP, "Ctrl-Z"),
    ],
)
def test_signals_request_an_abort(number, reason):
    """Each signal becomes a wish to stop, and afterwards does what it did before."""
    before = signal.getsignal(number)
    with AbortWatch() as watch:
        os.kill(os.getpid(), number)
        wait_for(lambda: watch.abort.count == 1)
    assert watch.abort.reason == reason
    assert signal.getsignal(number) == before


@pytest.mark.parametrize("reason", ["a key was pressed", "the terminal was lost"])
def test_a_key_or_a_lost_terminal_requests_an_abort(terminal, reason):
    """One key without Enter is enough; a terminal that is there is put back as it was."""
    master, slave = terminal
    before = termios.tcgetattr(slave)
    with AbortWatch(terminal=slave) as watch:
        os.write(master, b"x") if reason == "a key was pressed" else os.close(master)
        wait_for(lambda: watch.abort.count == 1)
    assert watch.abort.reason == reason
    assert reason == "the terminal was lost" or termios.tcgetattr(slave) == before


def test_without_a_terminal_only_signals_count(tmp_path):
    """Input from a file is no key."""
    with (tmp_path / "input").open("w+b") as file:
        file.write(b"keys")
        file.seek(0)
        with AbortWatch(terminal=file.fileno()) as watch:
            time.sleep(0.25)
    assert watch.abort.count == 0
