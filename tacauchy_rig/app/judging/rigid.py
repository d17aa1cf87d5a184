"""A baseline without mechanics: the indenter's own shape, cut into the gel.

So simple simulators draw: nothing bends next to the indenter, and nothing gives below it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np

from reports.evidence.attempt import RunReading
from sim.scene.indenter import Indenter
from sim.scene.pad import Pad
from sim.sensor.camera_geometry import CameraGeometry
from tacauchy_rig import __version__
from tacauchy_rig.app.replay.optics import Calibrate, optics_of
from tacauchy_rig.app.replay.parts import parts_of
from tacauchy_rig.app.replay.rendering import SAMPLES, drawn_image
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.simulated import REPLAY_NAME, Outputs, PressOutput, Simulator, model_of
from tacauchy_rig.core.versions import machine

NAME = "rigid penetration"
_NOTE = (
    "No mechanics: the indenter's shape cut into the gel at the measured depth, through our optics."
)


def rigid_outputs(
    run: RunReading, *, calibrate: Calibrate | None, on_progress: Callable[[str], None]
) -> Outputs:
    """Return what a simulator without mechanics shows of a run's presses.

    Args:
        calibrate: As for ``optics_of``.
        on_progress: Told what goes on, and which presses are left out.

    Raises:
        RecordError: No press has a measured depth and a no-contact frame.
    """
    inputs_by_trial = {n: part.inputs for part in parts_of(run) for n in part.trials}
    sensor = next(iter(inputs_by_trial.values())).sensor
    optics = optics_of(
        run.store.config.sensor.optics_calibration,
        sensor,
        calibrate=calibrate,
        on_progress=on_progress,
    )
    presses, spent_s = {}, 0.0
    for trial, record in run.records.items():
        attempt = run.attempt(trial)
        unloaded = None if attempt is None else attempt.reference
        if record is None or record.depth_measured_m is None or unloaded is None:
            on_progress(f"press {trial}: no depth or no no-contact frame: left out")
            continue
        started, inputs = time.perf_counter(), inputs_by_trial[trial]
        cut = partial(
            rigid_heights,
            sensor.pad,
            inputs.indenter,
            depth_m=record.depth_measured_m,
            place_m=_place(run, trial, inputs.offset_m),
        )
        image = drawn_image(*cut(optics.geometry.refined(SAMPLES)), optics, unloaded=unloaded)
        spent_s += time.perf_counter() - started
        rest, loaded = cut(optics.geometry)
        presses[trial] = PressOutput(image=image, height_m=loaded - rest)
    if not presses:
        raise RecordError(
            f"{run.store.paths.root}: no press of it has a measured depth",
            remedy="a rigid indenter goes as deep as the run measured: record or import depths",
        )
    simulator = Simulator(
        name=NAME,
        version=__version__,
        milliseconds_an_image=1e3 * spent_s / len(presses),
        machine=f"cpu, {machine()}",
        note=_NOTE,
    )
    missing = tuple(trial for trial in run.records if trial not in presses)
    return Outputs(simulator=simulator, presses=presses, left_out=missing)


def rigid_heights(
    pad: Pad,
    indenter: Indenter,
    geometry: CameraGeometry,
    *,
    depth_m: float,
    place_m: tuple[float, float] = (0.0, 0.0),
) -> tuple[FloatArray, FloatArray]:
    """Return z of the surface at rest and cut by an upright indenter [m], each [height, width].

    Args:
        depth_m: Of the tip below the pad's top at its place [m].
        place_m: Where the tip comes down, in the pad's frame [m].
    """
    x, y = geometry.pad_grid()
    rest = np.asarray(pad.height_at(x, y), dtype=np.float64)
    top = float(pad.height_at(np.array([place_m[0]]), np.array([place_m[1]]))[0])
    underside = top - depth_m + indenter.lower_surface(x - place_m[0], y - place_m[1])
    return rest, np.asarray(np.minimum(rest, underside))


def _place(run: RunReading, trial: int, stated_m: tuple[float, float]) -> tuple[float, float]:
    """Return where the tip came down, as our replay has it, or else as the run states [m]."""
    if REPLAY_NAME not in run.store.replays():
        return stated_m
    model = model_of(run.store.load_replay(REPLAY_NAME).models, trial)
    return model.centre_x_m, model.centre_y_m
