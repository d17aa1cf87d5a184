"""``python -m tests.studies acceptance``: from a lab's folder to the report, with its costs."""

import json
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import mkdtemp
from threading import Thread
from typing import Annotated, Any

import psutil
import typer

from tacauchy_rig.app.cli.output import Found, say, show_table
from tacauchy_rig.core.errors import RigError
from tacauchy_rig.core.tables import Cell, Table, table_of_rows
from tests.studies.acceptance.folder import SENSOR, Written, write_folder

MOST_COMMANDS, MOST_S, MOST_SILENT_S, MOST_BYTES = 6, 600.0, 3.0, 1_000_000_000
_LOOK_S, _SPREADS = 0.2, 3.0
KNOWN = (
    ("cylinder:diameter=4mm", "cylinder:diameter=4mm,fillet=0.1mm"),
    ("[rig.replay]\n", "[rig.replay]\nfriction = 0\n"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Called:
    """What a command took."""

    name: str
    status: int
    took_s: float
    processor_s: float  # of it and the processes that it started, all of them ended [s]
    silent_s: float  # the longest time without a line [s]
    most_bytes: int  # the most memory of it and the processes that it started, shared pages once
    lines: tuple[str, ...]


def called(*words: str) -> Called:
    """Run a command of the program and pass its lines on."""
    began = heard = time.monotonic()
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    silent_s, lines, most = 0.0, list[str](), [0]
    process = subprocess.Popen(  # the words are ours
        [sys.executable, "-u", "-c", "from tacauchy_rig.app.cli.app import main; main()", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    Thread(target=_watch, args=(process, most), daemon=True).start()
    for line in process.stdout or ():
        now = time.monotonic()
        silent_s, heard = max(silent_s, now - heard), now
        lines.append(line.rstrip())
        say(f"  {now - began:6.1f} s  {lines[-1]}")
    status, ended = process.wait(), time.monotonic()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return Called(
        name=" ".join(word for word in words[:2] if "/" not in word),
        status=status,
        took_s=ended - began,
        processor_s=after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        silent_s=max(silent_s, ended - heard),
        most_bytes=most[0],
        lines=tuple(lines),
    )


def _watch(process: subprocess.Popen[str], most: list[int]) -> None:
    own = psutil.Process(process.pid)
    while process.poll() is None:
        try:
            found = [own, *own.children(recursive=True)]
            most[0] = max(most[0], sum(each.memory_full_info().pss for each in found))
        except psutil.Error:  # one has just ended
            pass
        time.sleep(_LOOK_S)


def workflow(folder: Path, runs: Path) -> tuple[list[Called], Path]:
    """Call what a new user calls, each command as the one before says; return the run's folder.

    A person knows better than its guesses that the punch's edge is rounded and the gel was wetted.
    """
    found = [called("import", str(folder), "--init")]
    guess = folder / "import.toml"
    for guessed, known in KNOWN:
        guess.write_text(guess.read_text("utf-8").replace(guessed, known), "utf-8")
    found.append(called("import", str(folder), "--out", str(runs)))
    if found[-1].status:
        raise RigError(f"import ended with status {found[-1].status}: {found[-1].lines[-1]}")
    run = next(runs.iterdir())
    found.append(called("calibrate", "optics", str(run)))
    found.append(called("replay", str(run), "--optics", str(run / "optics" / "calibration.npz")))
    found.append(called("report", str(run)))
    return found, run


def costs_table(found: Sequence[Called], *, command: str) -> Table:
    """Return a line a command."""
    rows: list[dict[str, Cell]] = [
        {
            "command": c.name,
            "status": c.status,
            "took [s]": round(c.took_s, 1),
            "of processors [s]": round(c.processor_s, 1),
            "longest silence [s]": round(c.silent_s, 1),
            "memory [MB]": round(c.most_bytes / 1e6),
        }
        for c in found
    ]
    took_s = sum(c.took_s for c in found)
    everything: dict[str, Cell] = {
        "command": "all",
        "took [s]": round(took_s, 1),
        "of processors [s]": round(sum(c.processor_s for c in found), 1),
    }
    met = len(found) <= MOST_COMMANDS and took_s <= MOST_S
    met = met and all(c.silent_s <= MOST_SILENT_S for c in found)
    return table_of_rows(
        [*rows, dict.fromkeys(rows[0], "") | everything],
        title="From a folder to the report",
        criterion=f"{MOST_COMMANDS} commands, {MOST_S:g} s, {MOST_SILENT_S:g} s of silence and "
        f"{MOST_BYTES / 1e6:g} MB at most",
        passed=met and all(c.most_bytes <= MOST_BYTES for c in found),
        command=command,
    )


def truth_table(written: Written, summary: dict[str, Any], *, command: str) -> Table:
    """Set modulus and wins beside the truth; a place where one force was pressed has one rival."""
    model, true_pa = summary["model"], written.truth.young_pa
    off = model["young_pa"] / true_pa - 1.0
    stated = model["modulus_factor_deviation"] / model["modulus_factor"]
    margins = [t["force_margin"] for t in summary["trials"] if t["force_margin"] is not None]
    won = sum(each["value"] > 0.0 for each in margins)
    headline = [row for row in summary["headline"] if row["name"].startswith("contact_")]
    lost = sum(each["value"] < -_SPREADS * (each["spread"] or 0.0) for each in margins)
    return Table(
        title="What the report says beside the truth",
        columns=("what", "found", "truth or bound"),
        rows=(
            ("modulus [kPa]", round(model["young_pa"] / 1e3, 1), round(true_pa / 1e3, 1)),
            ("its error over the scatter between presses", round(abs(off) / stated, 2), 2.0),
            ("own force, or no contact, told apart rightly", won, len(margins)),
            ("wrongly, by more than noise explains", lost, 0),
            *((f"{each['name']} met", each["met"], each["trials"]) for each in headline),
        ),
        criterion="the modulus is within twice the scatter that is stated; no own force loses by "
        f"more than {_SPREADS:g} spreads of its noise",
        passed=abs(off) <= 2.0 * stated and not lost and bool(margins),
        command=command,
    )


def acceptance(
    presses: Annotated[int, typer.Option("--presses", min=13, help="How many.")] = 40,
    seed: Annotated[int, typer.Option("--seed", help="Of the emulated world.")] = 1,
    work: Annotated[Path | None, typer.Option("--work", help="Folder to work in; kept.")] = None,
) -> Found:
    """Press an emulated DIGIT at many places, and go from the folder to the report.

    Example: python -m tests.studies acceptance --presses 40 --seed 20261127
    """
    place = work or Path(mkdtemp(prefix="acceptance-"))
    folder = place / f"{SENSOR}-lab"
    command = f"python -m tests.studies acceptance --presses {presses} --seed {seed}"
    say(f"pressing the emulated sensor: {folder}")
    written = write_folder(folder, presses=presses, seed=seed)
    found, run = workflow(folder, place / "runs")
    summary = json.loads((run / "report" / "summary.json").read_text("utf-8"))
    tables = (costs_table(found, command=command), truth_table(written, summary, command=command))
    for table in tables:
        show_table(table)
    if work is None:
        shutil.rmtree(place)
    return Found({"tables": tables, "calls": found}, passed=all(table.passed for table in tables))
