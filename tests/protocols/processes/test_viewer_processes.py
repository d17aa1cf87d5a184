"""Viewers that die are started again, and given up in the end."""

import os
import signal
import socket
import time
from contextlib import closing

import pytest

from protocols.processes import child_process as viewing_module
from protocols.processes.child_process import Viewing
from protocols.processes.ipc import Job, PageOptions, ViewerOptions
from protocols.trials.trial_sequence import plan_session
from tacauchy_rig.core.errors import ConfigError


@pytest.fixture
def job(make_store):
    """What a viewer is told of a run."""
    store = make_store()
    return Job(root=store.paths.root, config=store.config, plan=plan_session(store), descriptors={})


def test_without_a_wish_nothing_is_opened(job):
    """No socket, no process, no address; and a port that is taken is refused by name before."""
    viewing = Viewing(None, job)
    viewing.start()
    assert (viewing.address, viewing.running()) == ("", [])
    viewing.close()
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(ConfigError, match=f"--page {port}") as caught:
            Viewing(PageOptions(port=port), job)
    assert "another port" in caught.value.remedy


def test_every_session_has_a_token_of_its_own(job):
    """Nobody can know the next one."""
    with closing(Viewing(PageOptions(), job)) as one, closing(Viewing(PageOptions(), job)) as other:
        tokens = {each.address.split("/")[3] for each in (one, other)}
    assert len(tokens) == 2
    assert all(len(token) >= 32 for token in tokens)


def test_a_page_that_dies_again_and_again_is_given_up(job, monkeypatch):
    """Started as often as is sensible, each time told, and then no more."""
    monkeypatch.setattr(viewing_module, "STARTS_MAX", 2)
    viewing = Viewing(PageOptions(), job)
    viewing.start()
    told = []
    deadline = time.monotonic() + 60.0
    while viewing.running() and time.monotonic() < deadline:
        for page in viewing.running():
            os.kill(page.process.pid, signal.SIGKILL)
        time.sleep(0.05)
        told += [happened for _, happened in viewing.restart_ended()]
    assert "started again" in told[0]
    assert "not started again" in told[1]
    assert list(viewing.restart_ended()) == []
    viewing.end()
    viewing.close()


@pytest.mark.parametrize(("status", "starts_again"), [(2, False), (1, True)])
def test_what_says_at_its_start_that_it_cannot_be_is_not_started_again(
    job, monkeypatch, tmp_path, status, starts_again
):
    """Two is the exit status of what is refused with a remedy, and it would be again."""
    words = "no such sensor"
    (tmp_path / "refusing.py").write_text(f"import sys\nprint({words!r})\nsys.exit({status})\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    viewing = Viewing(None, job, [ViewerOptions(name="twin", module="refusing")])
    viewing.start()
    deadline = time.monotonic() + 60.0
    while not (happened := [told for _, told in viewing.restart_ended()]):
        assert time.monotonic() < deadline
        time.sleep(0.02)
    assert words in happened[0]
    assert bool(viewing.running()) is ("not started again" not in happened[0]) is starts_again
    viewing.close()


def test_a_viewer_that_says_nothing_is_ended(job, monkeypatch):
    """Stopped, it neither reads nor dies: silence is what shows it."""
    viewing = Viewing(PageOptions(), job)
    viewing.start()
    [page] = viewing.running()
    deadline = time.monotonic() + 60.0
    while not page.receive():
        assert time.monotonic() < deadline
        time.sleep(0.05)
    os.kill(page.process.pid, signal.SIGSTOP)
    monkeypatch.setattr(viewing_module, "SILENT_S", 0.5)
    happened = []
    while not happened:
        assert time.monotonic() < deadline
        page.receive()
        happened = list(viewing.restart_ended())
        time.sleep(0.05)
    assert "had stopped answering" in happened[0][1]
    viewing.close()
