"""Stops by page and by key, the guard's reaction with and without a page, and rates with one."""

from __future__ import annotations

import http.client
import os
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np

from drivers.emulators.faults import Device
from drivers.emulators.launch import Emulation, with_addresses
from drivers.emulators.process import hang_weight
from protocols.guard.abort import Abort
from protocols.processes.messages import PageOptions, ViewerOptions
from protocols.processes.supervisor import run_session
from tacauchy_rig.app.twin.twin import Follows, twin_options
from tacauchy_rig.core.config.load import default_text, load_config
from tacauchy_rig.core.errors import DeviceError
from tacauchy_rig.core.run import FZ, JournalEvent, Phase
from tacauchy_rig.core.store.recording.reading import Recording
from tacauchy_rig.core.store.run_store import RunStore
from tacauchy_rig.core.tables import Table, table_of_rows
from tests.studies.page.bench import Bench, Session, busy_processor, watched

STOP_MORE_MS = 100.0
REACTION_MORE_MS = 2.0
WEIGHT_KG = 0.1
SLOWED = 0.98
"""Of the speed before: below it the arm has begun to stop."""
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
    with Bench(folder) as bench, busy_processor():

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
    force = Recording.open(session.store.paths.recording(1, record.attempt)).force()
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


def watched_run(folder: Path, *, watchers: int, trials: int) -> list[Row]:
    """Run emulated trials with a page and browsers on it; return rates and losses of each."""
    forces_n = load_config().config.protocol.force_targets[:trials]
    targets = ", ".join(f'"{force_n} N"' for force_n in forces_n)
    overrides = [f'run.output_directory="{folder}/runs"', f"protocol.force_targets=[{targets}]"]
    loaded = load_config(None, overrides=overrides)
    store = RunStore.create(
        folder / "runs", loaded, config_text=default_text(), simulated=True, versions={}
    )
    emulation = Emulation(loaded.config, folder=store.paths.emulation, devices=frozenset(Device))
    with emulation, ExitStack() as stack:

        def follow(event: JournalEvent) -> None:
            if event.name == "page":
                stack.enter_context(watched(str(event.detail["address"]), watchers))

        config = with_addresses(loaded.config, emulation.addresses)
        result = run_session(store, config, on_event=follow, abort=Abort(), page=PageOptions())
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


def reaction_table(pairs: Pairs) -> Table:
    """Return how quickly the guard reacted with a page and without."""
    return _reactions(pairs, "with a watched page", "without a page")


def twin_reaction_table(pairs: Pairs) -> Table:
    """Return how quickly the guard reacted with a twin and without."""
    return _reactions(pairs, "with a twin and a watched page", "with the page alone")


def _reactions(pairs: Pairs, one: str, other: str) -> Table:
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
