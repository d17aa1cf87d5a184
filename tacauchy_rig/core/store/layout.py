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
    """Names of a run folder's files. Trials and attempts count from 1."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.run_json = root / "run.json"  # what the run is: configuration, versions, devices
        self.rig_toml = root / "rig.toml"  # the configuration as it was written
        self.journal = root / "journal.jsonl"  # one line for each change of state
        self.force_check = root / "force_check.json"  # how the cell read a known weight
        self.expected = root / "expected.json"  # what its presses should give
        self.imported = root / "imported.json"  # what others recorded; imported runs only
        self.optics_json = root / "optics.json"  # what a calibration of the optics gave
        self.optics = root / "optics"  # folder of that calibration
        self.calibration = self.optics / "calibration.npz"
        # Each press next to its rendering by a model that was fitted without it.
        self.calibration_picture = self.optics / "calibration_held_out.png"
        self.truth = root / "truth.json"  # what the emulated world was; dry runs only
        self.emulation = root / "emulation"  # folder of the emulators
        self.twin = root / "twin.jsonl"  # what the twin showed, a line a frame; nothing needs it
        self.watch = root / "watch.html"  # the recorded run beside a twin, with a time slider
        self.lock = root / ".lock"  # locked while a program works on this run
        self.trials = root / "trials"
        self.replays = root / "replay"
        self.report = root / "report"

    def trial(self, trial: int) -> Path:
        """Return the folder of a trial."""
        return self.trials / f"{trial:02d}"

    def attempt(self, trial: int, attempt: int) -> Path:
        """Return the folder of one attempt at a trial."""
        return self.trial(trial) / f"attempt-{attempt}"

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
    """Return the places in a run's folder, which holds nothing but folders and plain files."""
    paths = RunPaths(root)
    if not any(path.is_file() for path in (paths.run_json, root / "run.json.previous")):
        raise RecordError(
            f"{root}: not a run folder: it has no run.json",
            remedy="give a folder that `tacauchy-rig run` or `dry-run` made, "
            "such as runs/20250131-101500-NAME",
        )
    check_tree(root)
    return paths
