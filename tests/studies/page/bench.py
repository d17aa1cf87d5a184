"""Sessions on emulated devices that something cuts off while the arm moves."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

from protocols.guard.abort import AbortWatch
from protocols.processes.messages import PageOptions, ViewerOptions
from protocols.processes.supervisor import SessionResult, run_session
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.errors import DeviceError
from tacauchy_rig.core.run import JournalEvent, Phase
from tacauchy_rig.core.store.run_store import RunStore
from tests.studies.fault_table.arm import ArmOutcome, arm_after, is_at_rest
from tests.studies.fault_table.emulated_rig import EmulatedRig

HOME_Z = "216 mm"
"""High enough for the arm to be on its way when it is stopped."""
UNDER_WAY_S = 0.4
REST_TIMEOUT_S = 5.0
WATCHERS = 3


@dataclass(slots=True, kw_only=True)
class Session:
    """One session under way, and what became of it.

    Attributes:
        address: Of its page; empty without one.
        terminal: Descriptor of the keyboard's side of its terminal.
        struck_ns: When it was cut off.
        result: How it ended.
        store: Its run folder.
    """

    store: RunStore
    terminal: int
    address: str = ""
    struck_ns: int = 0
    result: SessionResult | None = None
    events: list[JournalEvent] = field(default_factory=list)


class Bench:
    """Emulated devices that outlive the sessions on them; a context.

    Args:
        folder: Where everything goes.
    """

    def __init__(self, folder: Path) -> None:
        self.rig = EmulatedRig(folder)
        self._loaded = load_config(
            self.rig.rig_toml, overrides=[f'robot.home=["0 mm", "-400 mm", "{HOME_Z}"]']
        )

    def __enter__(self) -> Self:
        self.rig.devices.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.rig.devices.stop()

    def cut_off(
        self,
        strike: Callable[[Session], None],
        *,
        phase: Phase,
        page: bool = True,
        viewers: Sequence[ViewerOptions] = (),
    ) -> Session:
        """Run a session, strike it while the arm moves in ``phase``, and wait for its end."""
        store = RunStore.create(
            self.rig.folder / "runs",
            self._loaded,
            config_text=self.rig.rig_toml.read_text("utf-8"),
            simulated=True,
            versions={},
        )
        with _terminal() as (keyboard, screen):
            session = Session(store=store, terminal=keyboard)
            begin = _Striker(session, strike, phase)
            with AbortWatch(terminal=screen) as watch, ExitStack() as stack:
                begin.stack = stack
                session.result = run_session(
                    store,
                    self._loaded.config,
                    on_event=begin,
                    abort=watch.abort,
                    page=PageOptions() if page else None,
                    viewers=viewers,
                )
        if not session.struck_ns:
            raise DeviceError(f"the session ended before it was struck: {session.result.reason}")
        return session

    def arm_after(self, stamp_ns: int) -> ArmOutcome:
        """Return what the arm truly did after a moment, once it rests."""
        deadline = time.monotonic() + REST_TIMEOUT_S
        rows = self.rig.arm_trace()
        while not is_at_rest(rows, now_ns=time.monotonic_ns()) and time.monotonic() < deadline:
            time.sleep(0.05)
            rows = self.rig.arm_trace()
        return arm_after(rows, stamp_ns, now_ns=time.monotonic_ns())


class _Striker:
    """Follows a session: its page is watched, and it is struck in its phase."""

    def __init__(self, session: Session, strike: Callable[[Session], None], phase: Phase) -> None:
        self._session, self._strike, self._phase = session, strike, phase
        self.stack = ExitStack()

    def __call__(self, event: JournalEvent) -> None:
        self._session.events.append(event)
        if event.name == "page":
            self._session.address = str(event.detail["address"])
            self.stack.enter_context(watched(self._session.address))
        if event.name == "phase" and event.detail["phase"] == self._phase.value:
            threading.Timer(UNDER_WAY_S, self._do).start()

    def _do(self) -> None:
        self._session.struck_ns = time.monotonic_ns()
        self._strike(self._session)


@contextmanager
def watched(address: str, count: int = WATCHERS) -> Iterator[None]:
    """Have a page watched by as many browsers."""
    with _process("-m", "tests.studies.page.watcher", address, str(count)):
        yield


@contextmanager
def busy_processor() -> Iterator[None]:
    """Keep one processor busy with nothing."""
    with _process("-c", "while True: pass"):
        yield


@contextmanager
def _process(*arguments: str) -> Iterator[None]:
    process = subprocess.Popen([sys.executable, *arguments], start_new_session=True)
    try:
        yield
    finally:
        process.kill()
        process.wait()


@contextmanager
def _terminal() -> Iterator[tuple[int, int]]:
    """Yield both ends of a terminal: where keys are pressed, and where they are read."""
    keyboard, screen = pty.openpty()
    try:
        yield keyboard, screen
    finally:
        os.close(screen)
        os.close(keyboard)
