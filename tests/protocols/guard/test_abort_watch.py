"""Signals, keys and the loss of the terminal, each for real."""

from __future__ import annotations

import os
import pty
import signal
import termios
import time

import pytest

from protocols.guard.abort_watch import AbortWatch


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


def test_any_key_requests_an_abort(terminal):
    """One key without Enter is enough; the terminal is put back as it was."""
    master, slave = terminal
    before = termios.tcgetattr(slave)
    with AbortWatch(terminal=slave) as watch:
        os.write(master, b"x")
        wait_for(lambda: watch.abort.count == 1)
    assert watch.abort.reason == "a key was pressed"
    assert termios.tcgetattr(slave) == before


def test_a_lost_terminal_requests_an_abort(terminal):
    """When the other end of the terminal is gone, nobody can watch."""
    master, slave = terminal
    with AbortWatch(terminal=slave) as watch:
        os.close(master)
        wait_for(lambda: watch.abort.count == 1)
    assert watch.abort.reason == "the terminal was lost"


def test_without_a_terminal_only_signals_count(tmp_path):
    """Input from a file is no key."""
    with (tmp_path / "input").open("w+b") as file:
        file.write(b"keys")
        file.seek(0)
        with AbortWatch(terminal=file.fileno()) as watch:
            time.sleep(0.25)
    assert watch.abort.count == 0
