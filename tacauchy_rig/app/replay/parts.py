"""Parts of a run: presses of one indenter at one place, which share a mesh and a loading path."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from reports.evidence.attempt import RunReading
from sim.error import Tolerance
from sim.scene.indenter import describe
from tacauchy_rig.app.replay.inputs import ReplayInputs, inputs_of
from tacauchy_rig.app.replay.pressing import PressTask, has_measured, measured_records
from tacauchy_rig.core.config.model import RigConfig
from tacauchy_rig.core.imported import SAME_PLACE_M, ImportedTrial

Place = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """Trials that are pressed with one model.

    Attributes:
        run: Their reading.
        config: The run's, with their indenter and place.
        place_known: It is stated where the tip came down.
        label: Indenter and place, for progress; empty where all trials are alike.
    """

    run: RunReading
    inputs: ReplayInputs
    config: RigConfig
    place_known: bool = True
    label: str = ""

    @property
    def settled(self) -> ReplayInputs:
        """The inputs with the preset that ``auto`` chooses for what was asked or measured."""
        if not self.config.is_imported:
            return self.inputs.settled(self.config.protocol.force_targets)
        return self.inputs.settled(self.task.forces_n if has_measured(self.run) else [])

    @property
    def tool(self) -> str:
        """The indenter, as it is described."""
        return describe(self.inputs.indenter)

    @property
    def task(self) -> PressTask:
        """What its trials are pressed with; those of several parts quickly, where they can."""
        records = tuple(measured_records(self.run))
        return PressTask(
            inputs=self.inputs,
            records=records,
            config=self.config,
            label=self.label,
            quick=bool(self.label),
        )


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
    groups = list(_alike(trials)) or [[]]
    if len(groups) == 1:
        places = [trials[index].place_m for index in groups[0]]
        known = not places or None not in places or config.replay.offset is not None
        part = Part(
            run=run,
            inputs=_with(inputs_of(config), tolerance),
            config=config,
            place_known=known,
        )
        return [replace(part, inputs=part.settled)]
    parts = []
    for indices in groups:
        own, reading = [trials[index] for index in indices], run.of(indices)
        place, indenter = _place(own), own[0].indenter
        own_config = _with_press(config, indenter, place)
        where = "place unknown" if place is None else _millimetres(place)
        parts.append(
            Part(
                run=reading,
                inputs=_with(inputs_of(own_config), tolerance),
                config=own_config,
                place_known=place is not None or config.replay.offset is not None,
                label=f", {indenter or 'the indenter of the run'}, {where}",
            )
        )
    return parts


def _alike(trials: dict[int, ImportedTrial]) -> Iterator[list[int]]:
    """Yield numbers of trials of one indenter and one place, in order of the first."""
    groups: list[list[ImportedTrial]] = []
    for trial in trials.values():
        for group in groups:
            if group[0].indenter == trial.indenter and _is_near(group[0].place_m, trial.place_m):
                group.append(trial)
                break
        else:
            groups.append([trial])
    yield from ([trial.index for trial in group] for group in groups)


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


def _with_press(config: RigConfig, indenter: str, place: Place | None) -> RigConfig:
    stated = {"indenter": indenter or None, "offset": place}
    known = {name: value for name, value in stated.items() if value is not None}
    return config.model_copy(update={"replay": config.replay.model_copy(update=known)})


def _with(inputs: ReplayInputs, tolerance: Tolerance | None) -> ReplayInputs:
    return inputs if tolerance is None else replace(inputs, tolerance=tolerance, is_auto=False)


def _millimetres(place: Place) -> str:
    return f"at {place[0] * 1e3:.2f}, {place[1] * 1e3:.2f} mm"
