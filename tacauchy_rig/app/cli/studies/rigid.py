"""``tacauchy-rig rigid``: a run's presses as simulators without mechanics draw them."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tacauchy_rig import __version__
from tacauchy_rig.app.cli.options import RunFolder
from tacauchy_rig.app.cli.output import say
from tacauchy_rig.core.errors import RecordError

if TYPE_CHECKING:
    from reports.evidence.attempt import RunReading

NAME = "rigid penetration"
_NOTE = (
    "No mechanics: the indenter's shape cut into the gel at the measured depth, through our optics."
)


def rigid(
    folder: RunFolder,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="A new folder for judge.")],
) -> None:
    """Write what a simulator without mechanics shows of a run's presses, for ``judge``.

    Example: tacauchy-rig rigid runs/20261123-dry-run --out rigid
    """
    from sim.studies.rigid import rigid_heights
    from tacauchy_rig.app.cli.emulation import emulated_calibration
    from tacauchy_rig.app.judging.writing import check_empty, write_outputs
    from tacauchy_rig.app.replay.opening import open_run
    from tacauchy_rig.app.replay.optics import optics_of
    from tacauchy_rig.app.replay.parts import parts_of
    from tacauchy_rig.app.replay.rendering import SAMPLES, drawn_image
    from tacauchy_rig.core.outputs import Outputs, PressOutput, Simulator
    from tacauchy_rig.core.versions import machine

    check_empty(out)
    run = open_run(folder)
    config, parts = run.store.config, parts_of(run)
    inputs_by_trial = {trial: part.inputs for part in parts for trial in part.run.records}
    sensor = parts[0].inputs.sensor
    calibrate = emulated_calibration(run.store)
    optics = optics_of(
        config.sensor.optics_calibration, sensor, calibrate=calibrate, on_progress=say
    )
    presses, spent_s = {}, 0.0
    for trial, record in run.records.items():
        attempt = run.attempt(trial)
        unloaded = None if attempt is None else attempt.reference
        if record is None or record.depth_measured_m is None or unloaded is None:
            say(f"press {trial}: no depth or no no-contact frame: left out")
            continue
        started, inputs = time.perf_counter(), inputs_by_trial[trial]
        cut = partial(
            rigid_heights,
            sensor.pad,
            inputs.indenter,
            depth_m=record.depth_measured_m,
            place_m=_place(run, trial, inputs.mounting.offset_m),
        )
        rest, loaded = cut(optics.geometry.refined(SAMPLES))
        image = drawn_image(rest, loaded, optics, unloaded=unloaded)
        spent_s += time.perf_counter() - started
        rest, loaded = cut(optics.geometry)
        presses[trial] = PressOutput(image=image, height_m=loaded - rest)
    if not presses:
        raise RecordError(
            f"{folder}: no press of it has a measured depth",
            remedy="a rigid indenter goes as deep as it is told: record or import depths",
        )
    simulator = Simulator(
        name=NAME,
        version=__version__,
        milliseconds_an_image=1e3 * spent_s / len(presses),
        machine=f"cpu, {machine()}",
        note=_NOTE,
    )
    missing = tuple(trial for trial in run.records if trial not in presses)
    write_outputs(out, Outputs(simulator=simulator, presses=presses, left_out=missing))
    say(f"wrote {len(presses)} presses to {out}")


def _place(run: RunReading, trial: int, stated_m: tuple[float, float]) -> tuple[float, float]:
    """Return where the tip came down, as our replay has it, or else as the run states [m]."""
    from tacauchy_rig.app.replay.pressing import REPLAY_NAME
    from tacauchy_rig.core.replayed import model_of

    if REPLAY_NAME not in run.store.replays():
        return stated_m
    model = model_of(run.store.load_replay(REPLAY_NAME).models, trial)
    return model.centre_x_m, model.centre_y_m
