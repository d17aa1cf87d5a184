"""Where everything lies in a run folder."""

from __future__ import annotations

import re
from pathlib import Path

from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.store.run_files import check_tree

RESULT_NAME = "result.json"
SPILL_PATTERN = "unacknowledged-*.mcap"

_TRIAL = re.compile(r"0[1-9]|[1-9][0-9]{1,8}")
_ATTEMPT = re.compile(r"attempt-([1-9][0-9]{0,8})")


class RunPaths:
    """Names of a run folder's files. Trials and attempts count from 1.

    Attributes:
        run_json: What the run is: configuration, versions, devices, clock.
        rig_toml: The configuration as it was written.
        journal: One line for each change of state.
        force_check: How the cell read a known weight, where that was tried.
        expected: What its presses should give, made before the first.
        imported: What others recorded of it, and how; imported runs only.
        optics_json: What its presses gave when optics were calibrated from them.
        optics: Folder of that calibration.
        truth: What the emulated world really was; dry runs only.
        emulation: Folder of the emulators.
        twin: What the twin beside the run showed, a line a frame; nothing needs it.
        watch: The recorded run beside a twin of it, with a time slider.
        lock: File whose lock says that a program is working on this run.
        trials: Folder of all trials.
        replays: Folder of all replays.
        report: Folder of the report.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        self.run_json = root / "run.json"
        self.rig_toml = root / "rig.toml"
        self.journal = root / "journal.jsonl"
        self.force_check = root / "force_check.json"
        self.expected = root / "expected.json"
        self.imported = root / "imported.json"
        self.optics_json = root / "optics.json"
        self.optics = root / "optics"
        self.truth = root / "truth.json"
        self.emulation = root / "emulation"
        self.twin = root / "twin.jsonl"
        self.watch = root / "watch.html"
        self.lock = root / ".lock"
        self.trials = root / "trials"
        self.replays = root / "replay"
        self.report = root / "report"

    def trial(self, trial: int) -> Path:
        """Return the folder of a trial."""
        return self.trials / f"{trial:02d}"

    def attempt(self, trial: int, attempt: int) -> Path:
        """Return the folder of one attempt at a trial."""
        return self.trial(trial) / f"attempt-{attempt}"

    @property
    def calibration(self) -> Path:
        """Calibration of the optics from the run's own presses."""
        return self.optics / "calibration.npz"

    @property
    def calibration_picture(self) -> Path:
        """Each press next to its rendering by a model that was fitted without it."""
        return self.calibration.with_name("calibration_held_out.png")

    def recording(self, trial: int, attempt: int) -> Path:
        """Return the recording of an attempt."""
        return self.attempt(trial, attempt) / "recording.mcap"

    def result(self, trial: int, attempt: int) -> Path:
        """Return the verdict of an attempt."""
        return self.attempt(trial, attempt) / RESULT_NAME

    def spills(self, trial: int, attempt: int) -> list[Path]:
        """Return the messages that a fault kept from the recording, if any."""
        return sorted(self.attempt(trial, attempt).glob(SPILL_PATTERN))

    def spill(self, trial: int, attempt: int, source: str) -> Path:
        """Return where ``source`` (a process) writes what its recorder never acknowledged."""
        return self.attempt(trial, attempt) / SPILL_PATTERN.replace("*", source)

    def attempts(self) -> list[tuple[int, int]]:
        """Return (trial, attempt) of every attempt that has a folder, ascending."""
        names = (path.name for path in self.trials.glob("*") if path.is_dir())
        trials = sorted(int(name) for name in names if _TRIAL.fullmatch(name))
        return [(trial, attempt) for trial in trials for attempt in self.attempt_indices(trial)]

    def attempt_indices(self, trial: int) -> list[int]:
        """Return the attempts at a trial that have a folder, ascending."""
        matches = (_ATTEMPT.fullmatch(path.name) for path in self.trial(trial).glob("attempt-*"))
        return sorted(int(match.group(1)) for match in matches if match)

    def replay_json(self, name: str) -> Path:
        """Return the summary of a replay."""
        return self.replays / name / "replay.json"

    def replay_part(self, name: str, trial: int) -> Path:
        """Return what is kept of a finished part of a replay, by its first trial."""
        return self.replays / name / "parts" / f"{trial:02d}.json"

    def replay_trial(self, name: str, trial: int) -> Path:
        """Return the folder of one replayed trial: fields, surface, image, height."""
        return self.replays / name / "trials" / f"{trial:02d}"


def run_root_of(path: Path) -> Path:
    """Return the run folder that ``path`` lies in, or its own folder when it lies in none."""
    for folder in path.absolute().parents:
        if (folder / "run.json").is_file():
            return folder
    return path.parent


def run_folder(root: Path) -> RunPaths:
    """Return the places in a run's folder, which holds nothing but folders and plain files.

    Raises:
        RecordError: ``root`` is no run's folder, or holds what no run holds.
    """
    paths = RunPaths(root)
    if not any(path.is_file() for path in (paths.run_json, root / "run.json.previous")):
        raise RecordError(
            f"{root}: not a run folder: it has no run.json",
            remedy="give a folder that `tacauchy-rig run` or `dry-run` made, "
            "such as runs/20250131-101500-NAME",
        )
    check_tree(root)
    return paths
