"""What a calibration is made of, read and looked at before anything is simulated or fitted."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from sim.optics.calibrate.checks import FEWEST, check_before
from sim.optics.calibrate.presses.ball_press import (
    BallPress,
    check_presses_fit,
    check_size,
    read_ball_presses,
    read_rgb,
)
from sim.optics.calibrate.presses.find_circle import find_circle
from sim.optics.calibrate.presses.scene import PressScene
from sim.scene.scene import Preset
from sim.sensor.camera_geometry import CameraGeometry
from sim.sensor.sensor import Sensor
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.errors import ConfigError

_CIRCLES = "circles.csv"
_IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg")


@dataclass(frozen=True, slots=True, kw_only=True)
class OpticsRequest:
    """What a calibration is made of.

    Attributes:
        background: The no-contact frame, in the folder or a path of its own.
        circles: Table of contacts, in the folder or a path of its own; None takes ``circles.csv``
            of the folder where there is one, and finds the contacts in the images where not.
        ball_diameter_m: Diameter of the ball [m].
        scale_px_m: Pixels per metre along columns and rows.
        sensor: Its pad is pressed in the simulator to know the gel around the ball.
        jobs: Fits at a time, each in a process of its own.
    """

    folder: Path
    background: Path
    circles: Path | None
    ball_diameter_m: float
    scale_px_m: tuple[float, float]
    out: Path
    check: Path | None
    sensor: Sensor
    preset: Preset
    folds: int
    jobs: int

    @property
    def slopes(self) -> Path:
        """Where the map of the slopes that were seen is drawn."""
        return self.out.with_name(f"{self.out.stem}_slopes.png")

    @property
    def held_out(self) -> Path:
        """Where the presses held out are drawn."""
        return self.out.with_name(f"{self.out.stem}_held_out.png")

    @property
    def renderings(self) -> Path:
        """Folder of the presses held out as they were rendered, each by its own name."""
        return self.out.with_name(f"{self.out.stem}_held_out")


@dataclass(frozen=True, slots=True, kw_only=True)
class OpticsInput:
    """What was read.

    Attributes:
        background: No-contact frame, RGB, shape [height, width, 3].
        labelled: The presses where there is a table of their circles.
        images: The images of the presses where there is none, by name.
    """

    background: ImageArray
    geometry: CameraGeometry
    labelled: list[BallPress]
    images: dict[str, ImageArray]
    check: list[BallPress]


def read_input(request: OpticsRequest) -> OpticsInput:
    """Read everything that a calibration needs, and refuse what cannot be calibrated from.

    Raises:
        ConfigError: A file is missing or damaged, images differ in size, circles are impossible,
            or there are too few presses.
    """
    if request.out.suffix != ".npz":
        raise ConfigError(f"{request.out} is no .npz file", remedy="give --out calibration.npz")
    for folder in (request.folder, request.check):
        if folder is not None and not folder.is_dir():
            raise ConfigError(f"{folder} is no folder", remedy="give a folder of images")
    background = read_rgb(_found(request.background, request.folder))
    height, width = background.shape[:2]
    scale_x_m, scale_y_m = (1.0 / scale for scale in request.scale_px_m)
    geometry = CameraGeometry.centred(width, height, scale_x_m=scale_x_m, scale_y_m=scale_y_m)
    table = _found(request.circles, request.folder) if request.circles else None
    if table is None and (request.folder / _CIRCLES).exists():
        table = request.folder / _CIRCLES
    labelled = read_ball_presses(request.folder, table) if table else []
    check_presses_fit(labelled, background)
    images = _images(request, background) if table is None else {}
    if (count := len(labelled) + len(images)) < FEWEST:
        raise ConfigError(
            f"{count} ball presses are too few to calibrate and to check by",
            remedy=f"give at least {FEWEST}, better 20 all over the image and at several depths",
        )
    if labelled:
        check_before(labelled, geometry, ball_radius_m=0.5 * request.ball_diameter_m)
    check = []
    if request.check is not None:
        other = request.check / (request.circles or Path(_CIRCLES)).name
        table = other if other.exists() else request.check / _CIRCLES
        check = read_ball_presses(request.check, table)
        check_presses_fit(check, background)
    return OpticsInput(
        background=background, geometry=geometry, labelled=labelled, images=images, check=check
    )


def find_presses(
    read: OpticsInput, scene: PressScene, *, ball_radius_m: float
) -> tuple[list[BallPress], list[str]]:
    """Return the labelled presses, or find the contacts of those without labels; and warnings.

    Raises:
        ConfigError: An image shows no contact.
    """
    presses = list(read.labelled)
    for name, image in read.images.items():
        circle = find_circle(name, image, scene, ball_radius_m=ball_radius_m)
        presses.append(BallPress(name=name, image=image, circle=circle))
    return presses, check_before(presses, read.geometry, ball_radius_m=ball_radius_m)


def _found(path: Path, folder: Path) -> Path:
    """Return the path in the folder if it is there, else as it stands."""
    return folder / path if (folder / path).exists() else path


def _images(request: OpticsRequest, background: ImageArray) -> dict[str, ImageArray]:
    """Return the images of the folder but those that are no presses, by name."""
    own = (_found(request.background, request.folder), request.slopes, request.held_out)
    others = {path.resolve() for path in own}
    images = {
        path.name: read_rgb(path)
        for path in sorted(request.folder.iterdir())
        if path.suffix.lower() in _IMAGE_SUFFIXES and path.resolve() not in others
    }
    if not images:
        raise ConfigError(
            f"{request.folder} holds no image", remedy="give a folder of PNG or JPEG files"
        )
    for name, image in images.items():
        check_size(name, image, background)
    return images
