"""A run's true replay, kept in memory, and the evidence of replays that differ from it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from reports.evidence.evidence_types import RunEvidence
from reports.evidence.frames_and_curves import RunReading
from reports.evidence.gather_evidence import load_evidence, stated_curve
from sim.fields.saved_press import TrialFields
from sim.replay import replay_forces
from sim.scene.scene import Preset
from tacauchy_rig.app.replay.chosen_optics import Calibrate, OpticalCalibration, optics_of
from tacauchy_rig.app.replay.pressed_parts import press_together
from tacauchy_rig.app.replay.rendering import rendered as rendered_trials
from tacauchy_rig.app.replay.simulator_inputs import (
    Part,
    ReplayInputs,
    inputs_of,
    measured_attempts,
    measured_records,
)
from tacauchy_rig.app.replay.tilt_and_place import mounted
from tacauchy_rig.app.replay.uncertain_inputs import force_inputs
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.simulated import ForceInput, Replay
from tacauchy_rig.core.time_limit_and_progress import say


@dataclass(frozen=True, slots=True)
class Pressed:
    """A replay of which nothing is rendered yet, and the fields by trial."""

    replay: Replay
    fields: Mapping[int, TrialFields]


@dataclass(frozen=True, slots=True, kw_only=True)
class Bench:
    """What every wrong model starts from; nothing is written into the run's folder."""

    run: RunReading
    inputs: ReplayInputs  # what the run is truly replayed with
    optics: OpticalCalibration  # what it is truly rendered with
    recorded: RunEvidence  # what was read of the run, its checks with it
    pressed: Pressed  # the true replay
    images: Mapping[int, ImageArray]  # its images by trial
    force_inputs: tuple[ForceInput, ...] = ()  # what the force at a depth depends on

    @property
    def trials(self) -> Sequence[int]:
        """Trials that were replayed, the smallest force first."""
        forces = {trial.index: trial.force_measured_n for trial in self.pressed.replay.trials}
        return sorted(forces, key=forces.__getitem__)

    @property
    def modulus_factor(self) -> float:
        """What the true replay found of the modulus, over the stated one."""
        return self.pressed.replay.model.modulus_factor or 1.0

    def press(self, inputs: ReplayInputs) -> Pressed:
        """Press all trials otherwise, with the modulus that the run's depths then tell."""
        return _pressed(self.run, inputs)

    def press_first(self, inputs: ReplayInputs) -> Pressed:
        """Press the smallest force otherwise, with the true replay's modulus, and keep the rest.

        For what takes long to press: if one trial is caught, the run is.
        """
        first = self.trials[0]
        inputs = replace(inputs, sensor=inputs.sensor.stiffer(self.modulus_factor))
        force_n = [t.force_measured_n for t in self.pressed.replay.trials if t.index == first]
        replay, fields = replay_forces(inputs.scene(force_n), force_n)
        trials = tuple(
            replace(replay.trials[0], index=first) if trial.index == first else trial
            for trial in self.pressed.replay.trials
        )
        replay = replace(self.pressed.replay, trials=trials)
        return Pressed(replay, {**self.pressed.fields, first: fields[0]})

    def evidence(
        self, pressed: Pressed | None = None, *, optics: OpticalCalibration | None = None
    ) -> RunEvidence:
        """Return what a report is made from, the replay otherwise pressed or rendered."""
        pressed = pressed or self.pressed
        return self.seen(*rendered(self.run, self.inputs, pressed, optics or self.optics))

    def evidence_with(self, images: Mapping[int, ImageArray]) -> RunEvidence:
        """Return what a report is made from with other images of the true replay."""
        return self.seen(self.pressed.replay, images)

    def seen(self, replay: Replay, images: Mapping[int, ImageArray]) -> RunEvidence:
        """Return the true evidence with another replay; recordings are not read again."""
        replayed = {trial.index: trial for trial in replay.trials}
        trials = tuple(
            replace(
                trial,
                record=self.run.records[trial.index],
                replay=replayed.get(trial.index),
                simulated_image=images.get(trial.index),
                force_depth_simulated=stated_curve(replay, trial.index),
            )
            for trial in self.recorded.trials
        )
        model = replace(replay.model, force_inputs=self.force_inputs)
        return replace(self.recorded, trials=trials, model=model)


def bench_of(run: RunReading, *, preset: Preset, calibrate: Calibrate | None = None) -> Bench:
    """Replay a run truly, once for all of its wrong models."""
    inputs = replace(inputs_of(run.store.config), preset=preset, tolerance=None)
    config = run.store.config
    part = mounted(_part(run, inputs), measured_attempts(run))
    inputs = part.inputs
    given = run.store.config.sensor.optics_calibration
    optics = optics_of(given, inputs.sensor, calibrate=calibrate)
    say(f"replaying truly, preset {preset.value}")
    pressed = _pressed(run, inputs)
    replay, images = rendered(run, inputs, pressed, optics)
    return Bench(
        run=run,
        inputs=inputs,
        optics=optics,
        recorded=load_evidence(run, None),
        pressed=replace(pressed, replay=replay),
        images=images,
        force_inputs=force_inputs(inputs, config, part.depths_m, found=part.found),
    )


def _pressed(run: RunReading, inputs: ReplayInputs) -> Pressed:
    """Press a run's trials of one indenter at one place."""
    return Pressed(*press_together(_part(run, inputs)))


def _part(run: RunReading, inputs: ReplayInputs) -> Part:
    return Part(inputs=inputs, records=measured_records(run), config=run.store.config)


def rendered(
    run: RunReading, inputs: ReplayInputs, pressed: Pressed, optics: OpticalCalibration
) -> tuple[Replay, dict[int, ImageArray]]:
    """Render what was pressed: the replay as the camera sees it, and images by trial."""
    attempts = measured_attempts(run)
    replay, kept = rendered_trials(attempts, inputs.sensor, pressed.replay, pressed.fields, optics)
    return replay, {i: found.image for i, found in kept.items() if found.image is not None}
