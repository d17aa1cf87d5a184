"""Imperfections of a real sensor, measured in a recorded run, for environments."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from reports.evidence.evidence_types import ImageGeometry
from reports.evidence.frames_and_curves import RunReading, crop_and_resize, decode_frame
from sim.sensor.sensor import load_sensor
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import TrialRecord
from tacauchy_rig.core.store.run_store import RunStore
from tacauchy_rig.core.store.trusted_force import force_series

IMAGE_PX = (40, 30)
"""Columns and rows of the environments' images."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Imperfections:
    """Standard deviations over samples, episodes or units, and delays. Zero is a perfect sensor.

    Attributes:
        noise: Of a sample of the wrench [N, N m], length 6.
        zero: Of what a tare leaves of the wrench's zero [N, N m], length 6.
        drift_n_s: Of the drift of F_z after a tare [N/s].
        gain: Of the force sensor's gain [1].
        force_delay_s: From the arm's state to the force of the same moment [s].
        image_delay_s: From the arm's state to the image of the same moment [s].
        image_noise: Of a pixel of an image of 40 x 30 pixels [grey levels].
        stiffness: Of the gel's modulus between units [1].
    """

    noise: tuple[float, ...] = (0.0,) * 6
    zero: tuple[float, ...] = (0.0,) * 6
    drift_n_s: float = 0.0
    gain: float = 0.0
    force_delay_s: float = 0.0
    image_delay_s: float = 0.0
    image_noise: float = 0.0
    stiffness: float = 0.0


def imperfections_of_run(folder: Path) -> Imperfections:
    """Return what a recorded run says of its devices.

    Noise and zero are those of the tares, the drift is between the tares of a trial; the gain is
    what all independent sources leave open (``force_history``), at its most certain trial. The
    delays are those of the run's ``rig.toml``: zero where nobody measured them. The images' noise
    is of the frames before contact.

    Raises:
        RecordError: The folder is no run, or no trial was tared twice with frames before contact.
    """
    store = RunStore.open(folder)
    sensor, config = load_sensor(store.config.sensor.name), store.config
    geometry = ImageGeometry(
        crop_fraction=sensor.camera.crop_fraction, width_px=IMAGE_PX[0], height_px=IMAGE_PX[1]
    )
    run = RunReading(store, geometry)
    records = [record for record in run.records.values() if record is not None]
    tared = [
        (before, after)
        for record in records
        if (before := record.tare_before) is not None
        if (after := record.tare_after) is not None
    ]
    squares = [square for record in records for square in _squares(run, record)]
    if not tared or not squares:
        raise RecordError(
            f"{folder}: no trial was tared before and after its press, with images before contact",
            remedy="take a run of `tacauchy-rig run` or `dry-run` that has passed trials",
        )
    deviations = np.array([tare.deviation for pair in tared for tare in pair])
    counts = np.array([[tare.sample_count] for pair in tared for tare in pair])
    drifts = [
        1e9 * (after.mean[2] - before.mean[2]) / (after.start_ns - before.start_ns)
        for before, after in tared
    ]
    gains = force_series(store).history.trials
    return Imperfections(
        noise=_root_mean(deviations**2),
        zero=_root_mean(deviations**2 / counts),
        drift_n_s=float(np.sqrt(np.mean(np.square(drifts)))),
        gain=min((trial.gain_uncertainty for trial in gains), default=0.0),
        force_delay_s=config.force_sensor.delay,
        image_delay_s=config.camera.delay,
        image_noise=float(np.sqrt(np.mean(squares))),
        stiffness=sensor.young_uncertainty()[0],
    )


def _root_mean(squares: FloatArray) -> tuple[float, ...]:
    return tuple(np.sqrt(squares.mean(axis=0)).tolist())


def _squares(run: RunReading, record: TrialRecord) -> Iterator[float]:
    """Yield the variance of the pixels of a trial's frames before contact [grey levels^2]."""
    attempt = run.attempt(record.index)
    if attempt is None or "reference" not in record.windows:
        return
    decoded = map(decode_frame, attempt.recording.frames(*record.windows["reference"]))
    frames = [crop_and_resize(each, run.geometry) for each in decoded if each is not None]
    if len(frames) > 1:
        yield float(np.stack(frames).var(axis=0, ddof=1, dtype=np.float64).mean())
