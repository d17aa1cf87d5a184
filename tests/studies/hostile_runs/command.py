"""Study "hostile-runs": run folders made to do harm, against every command."""

import contextlib
import hashlib
import io
import logging
import os
import shutil
import signal
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from random import Random
from typing import Annotated
from unittest import mock

import numpy as np
import typer
from click.exceptions import ClickException
from matplotlib.figure import Figure

from sim.solve.descents import Descents
from sim.solve.equilibrium import EquilibriumSolver
from tacauchy_rig.app.cli.app import app
from tacauchy_rig.app.cli.output import Found, Jobs, complain, say
from tacauchy_rig.core.errors import RecordError, RigError
from tacauchy_rig.core.image_codec import decode_rgb, encode_jpeg
from tacauchy_rig.core.run import ImageFrame
from tacauchy_rig.core.store.recording.mcap_writer import RawMessage, Topic, decode_jpeg, encode
from tacauchy_rig.core.study import selected
from tests.recorded_run import new_run, press_run
from tests.studies.hostile_runs.kinds import all_kinds
from tests.studies.tampering.copy import Care, RunCopy
from tests.tacauchy_rig.app.results.made_runs import reported, served
from tests.tacauchy_rig.core.store.made_replay import made_replay

LIMIT_S = {signal.ITIMER_PROF: 60.0, signal.ITIMER_REAL: 300.0}
"""Of a command: processor time, and time on the wall, which on a busy machine says less."""
_SIGNALS = {signal.ITIMER_PROF: signal.SIGPROF, signal.ITIMER_REAL: signal.SIGALRM}
SHORT = ('robot.model="cb3"', 'replay.preset="fast"')
NEIGHBOUR = "20260101-neighbour"
COMMANDS: dict[str, Sequence[str]] = {
    "replay": ("replay", "RUN"),
    "replay --watch": ("replay", "RUN", "--watch"),
    "report": ("report", "RUN"),
    "recover": ("recover", "RUN"),
    "resume": ("resume", "RUN", "--press-only", "--again", "9"),
    "export csv": ("export", "RUN", "OUT/csv"),
    "export lerobot": ("export", "RUN", "OUT/lerobot", "--to", "lerobot"),
    "judge": ("judge", "--run", "RUN", "--out", "OUT/judged", "--baseline", "rigid"),
    "judge --task": ("judge", "--run", "RUN", "--out", "OUT/task", "--task"),
    "check-press": ("check-press", "RUN", "RUN"),
    "calibrate optics": ("calibrate", "optics", "RUN", "--jobs", "1", "--out", "OUT/optics.npz"),
    "calibrate material": ("calibrate", "material", "RUN", "--jobs", "1"),
    "calibrate latency": ("calibrate", "latency", "RUN"),
}
"""Commands that take a run; ``serve`` is asked for its pages."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Observation:
    """What a command made of a hostile run."""

    kind: str
    command: str
    outcome: str  # how it ended, in a word or two
    wall_s: float
    failure: str  # what was wrong with that; empty where nothing was


class _TooLongError(BaseException):
    """The time is up; nothing that catches errors catches it."""


def recorded(parent: Path, *, is_large: bool = True) -> Path:
    """Press two trials in simulated time, with a made-up replay and a report; return the run."""
    store = new_run(parent, *SHORT)
    press_run(store)
    copy = RunCopy(store.paths.root, Care.RESEALED)
    for trial in store.trial_indices() if is_large else ():
        copy.change_messages(trial, _enlarged)
    copy.reseal()
    store.truth.write(b'{"young_pa": 440000.0}\n')
    store.save_replay(*made_replay(store))
    reported(store.paths.root, modulus=1.0)
    return store.paths.root


def _enlarged(messages: list[RawMessage]) -> list[RawMessage]:
    """Give the mock camera's small images the size that reports need."""
    return [_large(each) if each.topic is Topic.IMAGE else each for each in messages]


def _large(message: RawMessage) -> RawMessage:
    image = decode_rgb(decode_jpeg(message.data))
    assert image is not None
    picture = encode_jpeg(np.repeat(np.repeat(image, 10, axis=0), 10, axis=1), quality=60)
    frame = ImageFrame(
        stamp_ns=message.log_time,
        counter=message.sequence,
        device_stamp_s=None,
        width=10 * message.width,
        height=10 * message.height,
        jpeg=picture,
    )
    return encode(frame)


def observe(kind: str, *, run: Path, seed: int, only: Sequence[str] = ()) -> list[Observation]:
    """Make a run of a kind, and let every command have a copy of it."""
    logging.getLogger("tacauchy_rig").setLevel(logging.CRITICAL)
    change = all_kinds()[kind]
    found = []
    for command in only or (*COMMANDS, "serve"):
        with tempfile.TemporaryDirectory(dir=run.parent) as folder:
            place, random = Path(folder), Random(f"{seed}-{kind}")  # noqa: S311
            outside = _outside(place)
            root = place / "runs" / run.name
            shutil.copytree(run, root)
            shutil.copytree(run, root.parent / NEIGHBOUR)
            change(root, outside, random)
            before = _state(outside)
            began_s = time.monotonic()
            outcome, failure = _tried(command, root, place / "out")
            if _state(outside) != before:
                failure = f"{failure}; what lies outside was changed"
            found.append(
                Observation(
                    kind=kind,
                    command=command,
                    outcome=outcome,
                    wall_s=time.monotonic() - began_s,
                    failure=failure,
                )
            )
    return found


def _outside(place: Path) -> Path:
    outside = place / "outside"
    (outside / "folder").mkdir(parents=True)
    (outside / "secret.txt").write_text("secret", "utf-8")
    (outside / "folder" / "report.html").write_text("secret", "utf-8")
    os.mkfifo(outside / "pipe.toml")
    return outside


def _state(folder: Path) -> dict[str, str]:
    paths = sorted(folder.rglob("*"))
    return {
        str(path): hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""
        for path in paths
    }


def _tried(command: str, root: Path, out: Path) -> tuple[str, str]:
    """Return how a command ended, and what was wrong with that."""
    told = io.StringIO()
    try:
        with (
            _limited(),
            _without_simulation(),
            contextlib.redirect_stdout(told),
            contextlib.redirect_stderr(told),
        ):
            return _served(root) if command == "serve" else _called(COMMANDS[command], root, out)
    except _TooLongError:
        return "too long", "it went on for too long"
    except RigError as error:
        return "refused", "" if error.message.isprintable() else _unprintable(error)
    except SystemExit as end:
        return f"ended with {end.code}", ""
    except Exception as error:  # noqa: BLE001 - this is what the study looks for
        return "unforeseen", f"{type(error).__name__}: {error}"


def _unprintable(error: RigError) -> str:
    lines = error.message.split("\n")
    return "" if all(line.isprintable() for line in lines) else f"unprintable: {error.message!r}"


def _called(words: Sequence[str], root: Path, out: Path) -> tuple[str, str]:
    known = [word.replace("RUN", str(root)).replace("OUT", str(out)) for word in words]
    try:
        code = app(known, standalone_mode=False)
    except (typer.Exit, ClickException) as end:
        code = end.exit_code
    return f"ended with {code or 0}", ""


def _served(root: Path) -> tuple[str, str]:
    """Ask for every page; the run beside the hostile one has to be shown all the same."""
    wrong = []
    with served(root.parent) as client:
        names = (root.name, NEIGHBOUR)
        listed = client.get("")
        if listed.status != 200 or any(name not in listed.text for name in names):
            wrong.append(f"the list: {listed.status}")
        for page in (f"compare?a={names[0]}&b={names[1]}", f"health/{names[1]}"):
            if (status := client.get(page).status) != 200:
                wrong.append(f"{page}: {status}")
        report = root / "report" / "report.html"
        # A hard link leads nowhere: the file lies in the run as much as it lies elsewhere.
        is_shared = report.is_file() and report.stat().st_nlink > 1
        if "secret" in client.of_run(root.name, "report/report.html").text and not is_shared:
            wrong.append("a file from outside was served")
        if client.of_run(NEIGHBOUR, "report/report.html").status != 200:
            wrong.append("the other run's report is not served")
    return "served", "; ".join(wrong)


@contextlib.contextmanager
def _limited() -> Iterator[None]:
    def end(*_: object) -> None:
        raise _TooLongError

    before = {timer: signal.signal(number, end) for timer, number in _SIGNALS.items()}
    for timer, limit_s in LIMIT_S.items():
        signal.setitimer(timer, limit_s)
    try:
        yield
    finally:
        for timer, number in _SIGNALS.items():
            signal.setitimer(timer, 0.0)
            signal.signal(number, before[timer])


@contextlib.contextmanager
def _without_simulation() -> Iterator[None]:
    """End a command where its simulation would begin: what it reads of a run is read by then.

    Figures are composed and not drawn: that takes most of the time of a report.
    """

    def end(*_: object, **__: object) -> None:
        raise RecordError("the study ends where the simulation begins")

    def save(_: Figure, place: Path, **__: object) -> None:
        Path(place).write_bytes(b"not drawn")

    with (
        mock.patch.object(EquilibriumSolver, "__init__", end),
        mock.patch.object(Descents, "__init__", end),
        mock.patch.object(Figure, "savefig", save),
    ):
        yield


def hostile_runs(
    only: Annotated[
        list[str] | None, typer.Option("--only", metavar="PATTERN", help="Of kinds.")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", help="Of what is drawn.")] = 1,
    jobs: Jobs = 2,
) -> Found:
    """Make run folders of every hostile kind, and let every command read each.

    A command fails that changes a file outside, takes a minute of processor time, or meets an
    error that nobody foresaw; `serve` fails, too, if it no longer shows the other run.

    Example: python -m tests.studies hostile-runs --only 'link*'
    """
    from tacauchy_rig.core.parallel import parallel_map

    kinds = selected(list(all_kinds()), only or (), names=lambda kind: (kind,), kind="kind of run")
    seen = []
    with tempfile.TemporaryDirectory() as folder:
        look = partial(observe, run=recorded(Path(folder)), seed=seed)
        for kind, found in parallel_map(look, kinds, jobs=jobs):
            outcomes = sorted({each.outcome for each in found})
            say(f"{kind[:90]}: {', '.join(outcomes)}; {sum(each.wall_s for each in found):.1f} s")
            for each in found:
                if each.failure:
                    complain(f"  {each.command}: {each.failure[:300]}")
            seen += found
    failed = [each for each in seen if each.failure]
    say(f"{len(kinds)} kinds, {len(seen)} trials of commands: {len(failed)} failed")
    return Found({"kinds": len(kinds), "seed": seed, "failed": failed}, passed=not failed)
