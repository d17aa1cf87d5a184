"""The parts of a run: presses of one indenter at one place, which share a mesh."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from reports.evidence.frames_and_curves import AttemptReading, RunReading
from sim.scene.indenter import describe
from sim.tolerance import Tolerance
from tacauchy_rig.app.replay.simulator_inputs import ReplayInputs, inputs_of
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.errors import RecordError, command_line
from tacauchy_rig.core.run import SAME_PLACE_M, ImportedTrial, TrialRecord

Place = tuple[float, float]
_FEW = 4
"""Parts of an indenter that tell of all, about."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """Trials that are pressed with one model; it can go to another process."""

    inputs: ReplayInputs
    records: tuple[TrialRecord, ...]  # of the trials that have a force, or else a depth
    config: RigConfig  # the run's, with their indenter and place
    trials: tuple[int, ...] = ()  # numbers of all trials, also of those that have neither
    place_known: bool = True  # it is stated where the tip came down
    label: str = ""  # indenter and place, for progress; empty where all trials are alike

    @property
    def forces_n(self) -> list[float]:
        """Measured forces [N], of the trials that have one."""
        return [r.force_measured_n for r in self.records if r.force_measured_n is not None]

    @property
    def depths_m(self) -> list[float]:
        """Measured depths [m], of the trials that have one."""
        return [r.depth_measured_m for r in self.records if r.depth_measured_m]

    @property
    def is_alone(self) -> bool:
        """Whether its one trial, of several parts, may be pressed on a mesh whose bias is known.

        Not where its depth counts from a force, which a path has to go to first.
        """
        from_touch = bool(self.forces_n) or not self.config.protocol.contact_force
        accurate = self.inputs.asked_accuracy is not None
        return bool(self.label) and len(self.records) == 1 and accurate and from_touch

    @property
    def settled(self) -> Part:
        """The part with the preset that ``auto`` chooses."""
        return replace(self, inputs=self.inputs.settled(self.forces_n))

    @property
    def tool(self) -> str:
        """The indenter, as it is described."""
        return describe(self.inputs.indenter)


def parts_of(run: RunReading, *, tolerance: Tolerance | None = None) -> list[Part]:
    """Return the parts of a run: one, unless it was imported and its presses differ.

    Of several parts nothing is pressed yet to choose a preset.

    Args:
        tolerance: Counts more than the configured one.

    Raises:
        ConfigError: An indenter, or what a replay is made with, does not exist.
        RecordError: The run was imported, and the file that says so is missing or damaged.
    """
    trials, config = run.store.imported_trials, run.store.config
    groups = _alike(trials)
    is_placed = config.replay.offset is not None

    def part_of(reading: RunReading, config: RigConfig, label: str, *, place_known: bool) -> Part:
        inputs = inputs_of(config)
        if tolerance is not None:
            inputs = replace(inputs, tolerance=tolerance, is_auto=False)
        return Part(
            inputs=inputs,
            records=tuple(_measured(reading)),
            config=config,
            trials=tuple(reading.records),
            place_known=place_known or is_placed,
            label=label,
        )

    if len(groups) <= 1:
        places = [trial.place_m for trial in trials.values()]
        part = part_of(run, config, "", place_known=None not in places)
        forces_n = part.forces_n if config.is_imported else config.protocol.force_targets
        return [replace(part, inputs=part.inputs.settled(forces_n))]
    parts = []
    for group in groups:
        place, indenter = _place(group), group[0].indenter
        stated = {"indenter": indenter or None, "offset": place}
        known = {name: value for name, value in stated.items() if value is not None}
        own = config.model_copy(update={"replay": config.replay.model_copy(update=known)})
        reading = run.of([trial.index for trial in group])
        where = "place unknown"
        if place is not None:
            where = f"at {place[0] * 1e3:.2f}, {place[1] * 1e3:.2f} mm"
        label = f", {indenter or 'the indenter of the run'}, {where}"
        parts.append(part_of(reading, own, label, place_known=place is not None))
    return parts


def measured_records(run: RunReading) -> tuple[TrialRecord, ...]:
    """Return the trials that have a force to replay; of an imported run also those with a depth.

    Raises:
        RecordError: There is none.
    """
    measured = tuple(_measured(run))
    if not measured:
        root = run.store.paths.root
        raise RecordError(
            f"{root}: no trial has a measured force to replay",
            remedy=f"`{command_line('resume', root)}` records them",
        )
    return measured


def measured_attempts(run: RunReading) -> list[AttemptReading]:
    """Return the attempts that ``measured_records`` names."""
    return [run.read(record) for record in measured_records(run)]


def tools_of(parts: Sequence[Part]) -> Iterator[list[int]]:
    """Yield the numbers of the parts of each indenter."""
    groups: dict[str, list[int]] = {}
    for k, part in enumerate(parts):
        groups.setdefault(part.tool, []).append(k)
    yield from groups.values()


def some_of_each(parts: Sequence[Part]) -> list[int]:
    """Return the numbers of the parts that tell of all: a few of each indenter, evenly taken."""
    return [k for own in tools_of(parts) for k in own[:: max(1, len(own) // _FEW)]]


def _measured(run: RunReading) -> Iterator[TrialRecord]:
    for record in run.records.values():
        if record is None:
            continue
        by_depth = run.store.config.is_imported and record.depth_measured_m is not None
        if record.force_measured_n is not None or by_depth:
            yield record


def _alike(trials: dict[int, ImportedTrial]) -> list[list[ImportedTrial]]:
    """Return trials grouped by indenter and place, in order of the first."""
    groups: list[list[ImportedTrial]] = []
    for trial in trials.values():
        for group in groups:
            if group[0].indenter == trial.indenter and _is_near(group[0].place_m, trial.place_m):
                group.append(trial)
                break
        else:
            groups.append([trial])
    return groups


def _is_near(first: Place | None, second: Place | None) -> bool:
    if first is None or second is None:
        return first is second
    return max(abs(a - b) for a, b in zip(first, second, strict=True)) <= SAME_PLACE_M


def _place(trials: list[ImportedTrial]) -> Place | None:
    known = [trial.place_m for trial in trials if trial.place_m is not None]
    if not known:
        return None
    x, y = np.mean(known, axis=0).tolist()
    return x, y
