"""A run, opened to be read; nothing of the simulator is loaded for that but sensors' files."""

from pathlib import Path

from reports.evidence.evidence_types import ImageGeometry
from reports.evidence.frames_and_curves import RunReading
from sim.sensor.sensor import Sensor, load_sensor
from tacauchy_rig.core.store.run_store import RunStore


def open_run(folder: Path | str) -> RunReading:
    """Open a run; forces and images are read when they are first asked for, and kept.

    Raises:
        RecordError: The folder is not a run, or its description is damaged.
        ConfigError: Its configuration is no longer accepted.
    """
    store = RunStore.open(Path(folder))
    return RunReading(store, scored_geometry(load_sensor(store.config.sensor.name)))


def scored_geometry(sensor: Sensor) -> ImageGeometry:
    """Return how frames of a sensor become the images that are scored."""
    view = sensor.camera
    return ImageGeometry(
        crop_fraction=view.crop_fraction,
        width_px=view.width,
        height_px=view.height,
        scale_x_m_px=view.scale_x_m,
        scale_y_m_px=view.scale_y_m,
    )
