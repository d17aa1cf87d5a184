"""The twin of a configuration: its simulator, and what starts its process."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

from protocols.processes.messages import ViewerOptions
from sim.sensor.sensor import Sensor
from sim.twin.follower import Follower, ImageOptions
from tacauchy_rig.app.replay.inputs import inputs_of
from tacauchy_rig.app.replay.optics import OpticalCalibration, optics_of, say_nothing
from tacauchy_rig.app.twin.images import CameraImages
from tacauchy_rig.core.config.model import RigConfig

NAME, MODULE = "twin", "tacauchy_rig.app.twin"
FOLLOWS, DEVICE = "follows", "device"


class Follows(StrEnum):
    """What a twin is pressed to."""

    FORCE = "force"
    DEPTH = "depth"


@dataclass(frozen=True, slots=True, kw_only=True)
class Twin:
    """A simulator that follows a run, and what makes images of its size of camera frames."""

    follower: Follower
    images: CameraImages


def twin_options(follows: Follows, *, device: str = "cpu") -> ViewerOptions:
    """Return what the supervisor starts; images are drawn on a device of Warp."""
    options = {FOLLOWS: follows.value, DEVICE: device}
    return ViewerOptions(name=NAME, module=MODULE, options=options)


def twin_of(
    config: RigConfig, *, optics: OpticalCalibration | None = None, device: str = "cpu"
) -> Twin:
    """Return what follows the presses of a configuration.

    Args:
        config: Of the run.
        optics: How images are made; None takes the configured calibration, or the nominal lamps.
        device: Where images are drawn.

    Raises:
        ConfigError: There is no such sensor or indenter, or nothing to render with.
        ConvergenceError: The largest target cannot be pressed.
    """
    inputs = inputs_of(config)
    found = optics or optics_of(
        config.sensor.optics_calibration, inputs.sensor, on_progress=say_nothing
    )
    options = ImageOptions(
        colours=found.model, geometry=found.geometry, blur_px=found.blur_px, device=device
    )
    sensor: Sensor = replace(
        inputs.sensor, optics=replace(inputs.sensor.optics, shadows=found.shadows)
    )
    follower = Follower(inputs.scene(config.protocol.force_targets), sensor, options)
    images = CameraImages(
        follower.view,
        crop_fraction=found.geometry.crop_fraction,
        frame_width_px=config.camera.width,
    )
    return Twin(follower=follower, images=images)
