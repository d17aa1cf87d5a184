"""Sessions on mocks in real time, and a real browser to watch them."""

import threading
import time
from contextlib import contextmanager

import pytest

from protocols.guard.abort import Abort
from protocols.processes.ipc import PageOptions
from protocols.processes.supervisor import run_session
from tests.mock.real_time import load_mocks, mocks_installed
from tests.protocols.conftest import BRISK
from tests.recorded_run import empty_run

ONE = 'protocol.force_targets=["1.2 N"]'
WAIT_S = 60.0
OUTLINE = {
    "image_size_px": (640, 480),
    "centre_px": (320.0, 240.0),
    "scale_px_m": (2e4, 2e4),
    "flat_radius_m": 2.4e-3,
    "ball_radius_m": 0.0,
}


class Running:
    """A session in a thread of its own."""

    def __init__(self, folder, *overrides):
        loaded = load_mocks(*BRISK, *overrides)
        self.store = empty_run(folder, loaded)
        self.abort, self.events, self.result = Abort(), [], None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        self.address = self.wait_for("page")["address"]

    def _run(self):
        self.result = run_session(
            self.store,
            self.store.config,
            on_event=self.events.append,
            abort=self.abort,
            page=PageOptions(outline=OUTLINE),
        )

    def wait_for(self, name, *, seen=0, **detail):
        """Return the detail of the first such event after ``seen`` earlier ones."""
        deadline = time.monotonic() + WAIT_S
        while time.monotonic() < deadline:
            is_on = self._thread.is_alive()  # before the look: its last event counts
            for event in self.events[seen:]:
                if event.name == name and detail.items() <= event.detail.items():
                    return event.detail
            assert is_on, f"no {name} {detail}, but the end: {self.result}"
            time.sleep(0.01)
        told = [(event.name, event.detail.get("phase")) for event in self.events]
        raise AssertionError(f"no {name} {detail} within {WAIT_S:g} s, but {told}")

    def end(self):
        """Return how it ended."""
        self._thread.join(WAIT_S)
        assert not self._thread.is_alive(), "the session does not end"
        return self.result


@contextmanager
def running(folder, *overrides):
    """Yield a session, ended whatever happens."""
    with mocks_installed():
        session = Running(folder, *overrides)
        try:
            yield session
        finally:
            session.abort.request("the test ends")
            session.end()


@pytest.fixture
def session(tmp_path):
    """One trial."""
    with running(tmp_path, ONE) as made:
        yield made


@pytest.fixture(scope="module")
def long_session(tmp_path_factory):
    """Many trials, for tests that leave them alone."""
    with running(tmp_path_factory.mktemp("runs")) as made:
        yield made


@pytest.fixture
def tab(chromium):
    """A maker of tabs, each as of a browser of its own; their errors fail the test."""
    contexts, errors = [], []

    def make(address, **how):
        context = chromium.new_context(**how)
        contexts.append(context)
        page = context.new_page()
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(address)
        page.wait_for_function("() => live !== null")
        return page

    yield make
    for context in contexts:
        context.close()
    assert errors == []
