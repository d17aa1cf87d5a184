"""Study "page": the cost of the operator's page, and how quickly it stops a run."""

import http.client
import os
import pty
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Self
from urllib.parse import urlsplit

import numpy as np
import typer

from drivers.emulators.faults import Device
from drivers.emulators.launch import Emulation
from drivers.emulators.process import hang_weight
from protocols.guard.abort import Abort, AbortWatch
from protocols.processes.ipc import PageOptions, ViewerOptions
from protocols.processes.supervisor import SessionResult, run_session
from sim.sensor.sensor import load_sensor
from tacauchy_rig.app.cli.emulated_calibration import emulated_unit
from tacauchy_rig.app.cli.output import Found, say, show_table, write_text
from tacauchy_rig.app.twin.run_follower import Follows, twin_options
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.errors import DeviceError
from tacauchy_rig.core.run import FZ, JournalEvent, Phase
from tacauchy_rig.core.store.recording.mcap_reader import Recording
from tacauchy_rig.core.store.run_store import RunStore
from tacauchy_rig.core.tables import Table, table_of_rows
from tests.recorded_run import empty_run
from tests.studies.fault_table.emulated_rig import EmulatedRig
from tests.studies.fault_table.observation import ArmOutcome, arm_after, is_at_rest

HOME_Z = "216 mm"  # high enough for the arm to be on its way when it is stopped
UNDER_WAY_S = 0.4
REST_TIMEOUT_S = 5.0
WATCHERS = 3


@dataclass(slots=True, kw_only=True)
class Session:
    """One session under way, and what became of it."""

    store: RunStore  # its run folder
    terminal: int  # descriptor of the keyboard's side of its terminal
    address: str = ""  # of its page; empty without one
    struck_ns: int = 0  # when it was cut off
    result: SessionResult | None = None  # how it ended
    events: list[JournalEvent] = field(default_factory=list)


class Bench:
    """Emulated devices that outlive the sessions on them; a context."""

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


def watched(address: str, count: int = WATCHERS) -> AbstractContextManager[None]:
    """Have a page watched by as many browsers."""
    return _process("-m", "tests.studies.page.watcher", address, str(count))


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


STOP_MORE_MS = 100.0
REACTION_MORE_MS = 2.0
WEIGHT_KG = 0.1
SLOWED = 0.98  # of the speed before: below it the arm has begun to stop
Say = Callable[[str], None]
Row = dict[str, str | float | None]


@dataclass(frozen=True, slots=True)
class Pairs:
    """Times of the same thing in two ways, pair by pair [ms]."""

    one_ms: tuple[float, ...]
    other_ms: tuple[float, ...]

    @property
    def more_ms(self) -> tuple[float, float]:
        """Mean of one less the other, and its 95 % half width, NaN of one pair [ms]."""
        more = np.array(self.one_ms) - np.array(self.other_ms)
        spread = more.std(ddof=1) if len(more) > 1 else np.nan
        return float(more.mean()), float(1.96 * spread / np.sqrt(len(more)))


def press_key(session: Session) -> None:
    """Press a key of the terminal."""
    os.write(session.terminal, b"x")


def press_button(session: Session) -> None:
    """Ask for a stop as the page's button does."""
    parts = urlsplit(session.address)
    connection = http.client.HTTPConnection(parts.hostname or "", parts.port, timeout=5.0)
    origin = f"{parts.scheme}://{parts.netloc}"
    connection.request("POST", f"{parts.path}stop", headers={"Origin": origin})
    connection.getresponse().read()


def stops(folder: Path, count: int, say: Say) -> Pairs:
    """Stop by button and by key in turn, with a busy processor and three pages watching."""
    with Bench(folder) as bench, _process("-c", "while True: pass"):

        def time_ms(strike: Callable[[Session], None]) -> float:
            session = bench.cut_off(strike, phase=Phase.AIR_PRESS)
            stopped_s = bench.arm_after(session.struck_ns).stopped_after_s
            if stopped_s is None:
                raise DeviceError("the arm never stood still")
            return stopped_s * 1e3

        return _pairs(lambda: time_ms(press_button), lambda: time_ms(press_key), count, say)


def reactions(folder: Path, count: int, say: Say) -> Pairs:
    """Hang a weight on the cell of a moving arm, with a watched page and without one."""
    with Bench(folder) as bench:
        return _pairs(
            lambda: _hang_ms(bench, page=True), lambda: _hang_ms(bench, page=False), count, say
        )


def twin_reactions(folder: Path, count: int, say: Say) -> Pairs:
    """Hang a weight on the cell of a moving arm, with a page and a twin, and with a page alone."""
    twin = [twin_options(Follows.FORCE)]
    with Bench(folder) as bench:
        return _pairs(lambda: _hang_ms(bench, viewers=twin), lambda: _hang_ms(bench), count, say)


def _hang_ms(bench: Bench, *, page: bool = True, viewers: Sequence[ViewerOptions] = ()) -> float:
    """Return how quickly the guard reacts to a weight that is hung on the cell [ms]."""

    def hang(_session: Session) -> None:
        hang_weight(bench.rig.devices.folder, WEIGHT_KG)

    try:
        session = bench.cut_off(hang, phase=Phase.APPROACH, page=page, viewers=viewers)
    finally:
        hang_weight(bench.rig.devices.folder, 0.0)
    return _reaction_ms(bench, session)


def _pairs(one: Callable[[], float], other: Callable[[], float], count: int, say: Say) -> Pairs:
    """Measure both in turn, each first in every other pair."""
    found: list[tuple[float, float]] = []
    for number in range(count):
        if number % 2:
            second = other()
            found.append((one(), second))
        else:
            found.append((one(), other()))
        say(f"  pair {number + 1} of {count}: {found[-1][0]:.1f} and {found[-1][1]:.1f} ms")
    return Pairs(tuple(pair[0] for pair in found), tuple(pair[1] for pair in found))


def _reaction_ms(bench: Bench, session: Session) -> float:
    """Return from the arrival of the first force beyond its limit until the arm slows down [ms]."""
    bench.arm_after(session.struck_ns)
    record = session.store.latest(1)
    if record is None or record.tare_before is None:
        raise DeviceError("the session left no tare to judge its forces by")
    force = Recording.open(session.store.paths.recording(1, record.attempt)).force
    pressing = force.wrench[:, FZ] - record.tare_before.mean[FZ]
    limit = bench.rig.config.limits.early_contact
    beyond = force.stamp_ns[(np.abs(pressing) > limit) & (force.stamp_ns > session.struck_ns)]
    rows = bench.rig.arm_trace()
    before = [row for row in rows if row.stamp_ns <= beyond[0]][-1]
    slow = (
        row.stamp_ns
        for row in rows
        if row.stamp_ns > beyond[0] and abs(row.velocity[2]) < SLOWED * abs(before.velocity[2])
    )
    return (next(slow) - int(beyond[0])) * 1e-6


def emulated_session(
    folder: Path,
    overrides: Sequence[str],
    *,
    on_event: Callable[[JournalEvent], None] = lambda _: None,
    viewers: Sequence[ViewerOptions] = (),
) -> tuple[RunStore, SessionResult]:
    """Press a configuration's trials on emulated devices, with a page."""
    loaded = load_config(overrides=[f'run.output_directory="{folder}"', *overrides])
    store = empty_run(folder, loaded)
    emulation = Emulation(
        loaded.config,
        folder=store.paths.emulation,
        devices=frozenset(Device),
        unit=emulated_unit(load_sensor(loaded.config.sensor.name)),
    )
    with emulation:
        return store, run_session(
            store,
            emulation.running,
            on_event=on_event,
            abort=Abort(),
            page=PageOptions(),
            viewers=viewers,
        )


def watched_run(folder: Path, *, watchers: int, trials: int) -> list[Row]:
    """Run emulated trials with a page and browsers on it; return rates and losses of each."""
    forces_n = load_config().config.protocol.force_targets[:trials]
    targets = ", ".join(f'"{force_n} N"' for force_n in forces_n)
    with ExitStack() as stack:

        def follow(event: JournalEvent) -> None:
            if event.name == "page":
                stack.enter_context(watched(str(event.detail["address"]), watchers))

        overrides = [f"protocol.force_targets=[{targets}]"]
        _, result = emulated_session(folder / "runs", overrides, on_event=follow)
    return [
        {
            "trial": record.index,
            "outcome": record.outcome.value,
            "force [Hz]": record.rates["force_rate_hz"],
            "lost force": round(record.rates["force_lost_count"]),
            "images [Hz]": record.rates["image_rate_hz"],
            "lost images": round(record.rates["image_lost_count"]),
            "control loop, 99 % [ms]": record.rates["control_loop_ms_p99"],
        }
        for record in result.records
    ]


def stop_table(pairs: Pairs) -> Table:
    """Return how long stops took."""
    more_ms, half_ms = pairs.more_ms
    return table_of_rows(
        [_row("page's button", pairs.one_ms), _row("terminal's key", pairs.other_ms)],
        title="Stop, until the arm stood still",
        criterion=f"the button's mean is at most {STOP_MORE_MS:g} ms above the key's",
        passed=more_ms <= STOP_MORE_MS,
        note=f"The button took {more_ms:+.1f} ± {half_ms:.1f} ms more (95 %).",
    )


def reaction_table(pairs: Pairs, one: str, other: str) -> Table:
    """Return how quickly the guard reacted with something beside it and without."""
    more_ms, half_ms = pairs.more_ms
    return table_of_rows(
        [_row(one, pairs.one_ms), _row(other, pairs.other_ms)],
        title="Guard, from the sample beyond its limit until the arm slowed down",
        criterion=f"the means differ by at most {REACTION_MORE_MS:g} ms",
        passed=abs(more_ms) <= REACTION_MORE_MS,
        note=f"{one[0].upper()}{one[1:]} it took {more_ms:+.2f} ± {half_ms:.2f} ms more (95 %).",
    )


def rate_table(rows: Sequence[Row]) -> Table:
    """Return rates of trials with a page."""
    return table_of_rows(
        rows,
        title="Trials with a watched page",
        criterion="nothing lost, 100 Hz and 18.75 Hz to 1 %",
        passed=all(
            row["lost force"] == row["lost images"] == 0
            and abs(float(row["force [Hz]"] or 0.0) - 100.0) <= 1.0
            and abs(float(row["images [Hz]"] or 0.0) - 18.75) <= 0.1875
            for row in rows
        ),
    )


def _row(name: str, times_ms: Sequence[float]) -> Row:
    middle, late = np.percentile(times_ms, (50, 95))
    return {
        "": name,
        "times": len(times_ms),
        "mean [ms]": float(np.mean(times_ms)),
        "median [ms]": float(middle),
        "95 % [ms]": float(late),
        "longest [ms]": max(times_ms),
    }


NOTE = (
    "Measured on emulated devices, by what the emulated arm truly did. Stops are asked for while "
    "the arm goes down, with one processor kept busy; pages are watched by three clients that read "
    "events and fetch pictures."
)


def page_check(
    stop_count: Annotated[
        int, typer.Option("--stops", min=1, help="By button and by key, each.")
    ] = 50,
    pair_count: Annotated[
        int, typer.Option("--pairs", min=1, help="Of the guard's reaction.")
    ] = 20,
    trials: Annotated[int, typer.Option("--trials", min=1, help="Pressed with a page.")] = 6,
    out: Annotated[Path, typer.Option("--out", help="The page.")] = Path(
        "docs/results/page_check.md"
    ),
    work: Annotated[Path, typer.Option("--work", help="Folder of its runs.")] = Path(
        "runs/page-check"
    ),
) -> Found:
    """Stop by page and key, react with a page and without, and press with a page.

    Example: python -m tests.studies page --stops 50 --pairs 20
    """
    from tacauchy_rig.core.markdown_page import criteria_page

    work.mkdir(parents=True, exist_ok=True)
    say(f"{trials} trials with a page")
    tables = [rate_table(watched_run(work.resolve() / "rates", watchers=3, trials=trials))]
    say("stops by button and by key")
    tables.append(stop_table(stops(work / "stops", stop_count, say)))
    say("the guard with a page and without")
    found = reactions(work / "guard", pair_count, say)
    tables.append(reaction_table(found, "with a watched page", "without a page"))
    for table in tables:
        show_table(table)
    command = f"python -m tests.studies page --stops {stop_count} --pairs {pair_count}"
    write_text(out, criteria_page(tables, title="What the page costs", note=NOTE, command=command))
    say(f"page {out}")
    return Found({"tables": tables}, passed=all(table.passed for table in tables))
