"""The twin of a configuration: it follows a run that goes on, or that was recorded."""

import json
import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import StrEnum
from importlib import resources
from pathlib import Path
from time import monotonic_ns, process_time
from typing import Any

import cv2
import numpy as np
from scipy.ndimage import label

from protocols.processes.ipc import Shown, ViewerOptions
from reports.evidence.evidence_types import ImageGeometry
from reports.evidence.frames_and_curves import (
    AttemptReading,
    RunReading,
    crop_and_resize,
    median_image,
)
from reports.scores.contact_scores import (
    contact_footprint,
    contact_region,
    image_change,
    relative_residual,
)
from sim.sensor.camera_geometry import CameraGeometry
from sim.sensor.sensor import Sensor
from sim.twin.press_follower import NO_FORCE_N, Follower, Goal, ImageOptions, TwinFrame
from tacauchy_rig.app.replay.chosen_optics import OpticalCalibration, optics_of
from tacauchy_rig.app.replay.simulator_inputs import inputs_of
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.image_codec import data_url, decode_rgb, encode_jpeg, reduction_to
from tacauchy_rig.core.run import JournalEvent, Phase
from tacauchy_rig.core.time_limit_and_progress import say

_QUALITY = 85


class CameraImages:
    """Frames of a camera as images of a twin's size.

    Args:
        view: Where the pixels of the twin's images look.
        crop_fraction: Part of a frame's width and height cut off at each border.
        frame_width_px: Of the camera's frames.
    """

    def __init__(self, view: CameraGeometry, *, crop_fraction: float, frame_width_px: int) -> None:
        self._geometry = ImageGeometry(
            crop_fraction=crop_fraction, width_px=view.width, height_px=view.height
        )
        room = (1.0 - 2.0 * crop_fraction) * frame_width_px / view.width
        self._reduction = reduction_to(room)

    def of(self, jpeg: bytes) -> ImageArray | None:
        """Return the image of a frame, RGB; None where it is no whole image or too small."""
        image = decode_rgb(jpeg, reduction=self._reduction)
        if image is None:
            return None
        try:
            return crop_and_resize(image, self._geometry)
        except RecordError:
            return None


def contact_residual(real: ImageArray, simulated: ImageArray, unloaded: ImageArray) -> float | None:
    """Return |real - simulated| / |real| of the changes in the contact that the real image shows.

    0 is perfect, 1 is what no contact would leave; None where the real image shows no contact.
    """
    change = image_change(real, unloaded)
    footprint = contact_footprint(change)
    if footprint is None:
        return None
    region = contact_region(footprint)
    found = relative_residual(change, image_change(simulated, unloaded), region)
    return found if math.isfinite(found) else None


def jpeg_of(image: ImageArray) -> bytes:
    """Return an RGB image as JPEG."""
    return encode_jpeg(image, quality=_QUALITY)


def maps_of(frame: TwinFrame) -> dict[str, tuple[float, bytes]]:
    """Return the largest value [kPa] and a JPEG of the maps that a frame has, by name.

    Black is nothing, light yellow the largest value.
    """
    found = {}
    for name, values in (("pressure", frame.pressure_pa), ("shear", frame.shear_pa)):
        if values is None:
            continue
        most_pa = float(values.max())
        share = np.clip(values / max(most_pa, 1e-300), 0.0, 1.0)
        drawn = cv2.applyColorMap(np.rint(255.0 * share).astype(np.uint8), cv2.COLORMAP_INFERNO)
        image = np.asarray(cv2.cvtColor(drawn, cv2.COLOR_BGR2RGB), np.uint8)
        found[name] = 1e-3 * most_pa, jpeg_of(image)
    return found


NAME, MODULE = "twin", "tacauchy_rig.app.twin.twin_process"
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
        optics: How images are made; None takes the configured calibration, or the nominal lamps.

    Raises:
        ConfigError: There is no such sensor or indenter, or nothing to render with.
        ConvergenceError: The largest target cannot be pressed.
    """
    inputs = inputs_of(config)
    found = optics or optics_of(config.sensor.optics_calibration, inputs.sensor)
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


FOLLOWED = {Phase.APPROACH, Phase.SEARCH, Phase.PRESS, Phase.DWELL, Phase.RETRACT}
MAPS_EVERY = 4
"""Frames: maps take as long as press and image together."""
RESIDUAL_EVERY = 2
_PICTURES = 8
STALE_NS = 500_000_000
"""Older values are not followed: a feed that was full keeps its oldest."""


class RunFollower:
    """Takes in the feeds and events of a run, and presses the twin to its latest values.

    Of several goals that came the latest is followed. A depth counts from the height at which the
    press begins, plus the depth that the force has reached by then.

    Attributes:
        dropped_count: Goals that a newer one replaced, or that were too old to be followed.
    """

    def __init__(self, twin: Twin, follows: Follows) -> None:
        self.twin, self.dropped_count = twin, 0
        self._follows = follows
        self._pictures: deque[tuple[int, bytes]] = deque(maxlen=_PICTURES)
        self._goal: Goal | None = None
        self._began: tuple[float, float] | None = None
        self._unloaded: ImageArray | None = None
        self._phase, self._trial, self._count = "", 0, 0
        self._height_m = self._depth_m = 0.0
        self._residual: float | None = None

    def take(self, shown: Shown) -> None:
        """Take what a feed shows."""
        stamp_s = shown.stamp_ns * 1e-9
        if shown.stream == "camera" and shown.picture is not None:
            self._pictures.append((shown.stamp_ns, shown.picture))
        elif shown.stream == "force" and self._began is None:
            self._put(Goal(stamp_s=stamp_s, force_n=float(shown.numbers["force_n"][-1])))
        elif shown.stream == "arm":
            self._height_m = float(shown.numbers["position_m"][2])
            if self._began is not None:
                height_m, depth_m = self._began
                sunk_m = max(0.0, depth_m + height_m - self._height_m)
                self._put(Goal(stamp_s=stamp_s, depth_m=sunk_m))

    def note(self, event: JournalEvent) -> None:
        """Take in an event of the journal."""
        self._trial = event.trial or self._trial
        if event.name != "phase":
            return
        before, self._phase = self._phase, str(event.detail.get("phase", ""))
        if before == Phase.REFERENCE:
            found = [self.twin.images.of(picture) for _, picture in self._pictures]
            if readable := [image for image in found if image is not None]:
                self._unloaded = median_image(readable)
                self.twin.follower.unloaded(self._unloaded)
        if self._phase == Phase.PRESS and self._follows is Follows.DEPTH:
            self._began = self._height_m, self._depth_m
        elif self._phase not in FOLLOWED:
            self._began = None

    def goal(self) -> Goal | None:
        """Return the latest goal and forget it; None if there is no new one."""
        found, self._goal = self._goal, None
        return found

    def step(self) -> tuple[dict[str, Any], list[Shown]] | None:
        """Follow the latest goal; None where there is none, or nothing is pressed now.

        Returns:
            A line of ``twin.jsonl``, and what viewers are shown.
        """
        goal = self.goal()
        if goal is None or self._phase not in FOLLOWED:
            return None
        if monotonic_ns() - goal.stamp_s * 1e9 > STALE_NS:
            self.dropped_count += 1
            return None
        started_s = process_time()
        frame = self.twin.follower.follow(goal, maps=self._count % MAPS_EVERY == 0)
        self._depth_m = frame.depth_m
        if self._count % RESIDUAL_EVERY == 0:
            self._residual = self._left(goal, frame)
        self._count += 1
        stamp_ns = round(goal.stamp_s * 1e9)
        picture = jpeg_of(frame.image)
        line = {
            "stamp_ns": stamp_ns,  # of the force or depth that was followed
            "trial": self._trial,
            "asked_n": goal.force_n,  # the force that was followed; None where it was a depth
            "force_n": frame.force_n,  # the twin's F_z [N]
            "force_error_n": frame.force_error_n,  # stated error of that [N]
            "depth_m": frame.depth_m,
            "residual": self._residual,  # inside the contact; None where it was not looked at
            "lag_ms": (monotonic_ns() - stamp_ns) * 1e-6,  # from that stamp to the picture
            "solve_ms": 1e3 * frame.solve_s,
            "draw_ms": 1e3 * frame.draw_s,
            # Processor time of all of it; what others take is not in it.
            "processor_ms": 1e3 * (process_time() - started_s),
            "dropped": self.dropped_count,  # forces left out so far because newer ones had come
            "note": frame.note,  # why the frame is not of what was followed
        }
        return line, list(_shown(line, frame, picture))

    def picture(self, stamp_s: float) -> bytes | None:
        """Return the camera's frame that is nearest in time, of the last few."""
        nearest = min(self._pictures, key=lambda each: abs(each[0] * 1e-9 - stamp_s), default=None)
        return None if nearest is None else nearest[1]

    def _put(self, goal: Goal) -> None:
        self.dropped_count += self._goal is not None
        self._goal = goal

    def _left(self, goal: Goal, frame: TwinFrame) -> float | None:
        jpeg = self.picture(goal.stamp_s)
        real = None if jpeg is None else self.twin.images.of(jpeg)
        if real is None or self._unloaded is None or frame.force_n == 0.0:
            return None
        return contact_residual(real, frame.image, self._unloaded)


def _shown(line: dict[str, Any], frame: TwinFrame, picture: bytes) -> Iterator[Shown]:
    stamp_ns = line["stamp_ns"]
    numbers: dict[str, Any] = {  # the page shows them in this order
        "force_n": frame.force_n,
        "force_error_n": frame.force_error_n,
        "depth_mm": 1e3 * frame.depth_m,
        "lag_ms": line["lag_ms"],
        "residual": line["residual"],
        "left_out": line["dropped"],
        **({"note": frame.note} if frame.note else {}),
    }
    yield Shown(stream="twin", stamp_ns=stamp_ns, numbers=numbers, picture=picture)
    for name, (most_kpa, drawn) in maps_of(frame).items():
        numbers = {"max_kpa": most_kpa}
        yield Shown(stream=f"twin {name}", stamp_ns=stamp_ns, numbers=numbers, picture=drawn)


FRAMES_PER_S = 5.0
_MARGIN_NS = 400_000_000
_TEMPLATE, _DATA = "watch.html", "{{ data }}"


def watch_run(run: RunReading, *, optics: OpticalCalibration | None = None) -> Path:
    """Have a twin follow what was recorded, at its own pace, and write the page of it.

    Args:
        run: The run; the page is written into its folder.
        optics: How images are made; None takes the configured calibration, or the nominal lamps.

    Returns:
        The page: one file that needs no other.

    Raises:
        RecordError: No trial has a recorded contact.
        ConfigError: There is nothing to simulate or render with.
    """
    config = run.store.config
    twin = twin_of(config, optics=optics)
    trials: list[tuple[int, list[dict[str, Any]]]] = []
    for trial in run.records:
        attempt = run.attempt(trial)
        frames = [] if attempt is None else list(_frames(attempt, twin))
        if frames:
            say(f"trial {trial}: {len(frames)} frames")
            trials.append((trial, frames))
    if not trials:
        raise RecordError(
            f"{run.store.paths.root}: no trial has images of a contact",
            remedy="press, or look at the run with `tacauchy-rig recover`",
        )
    facts = {
        "run": run.store.paths.root.name,
        "simulated": run.store.simulated,
        "basis": twin.follower.stated_error.basis,
        "trials": [{"trial": trial, "frames": frames} for trial, frames in trials],
    }
    page = _template().replace(_DATA, json.dumps(facts).replace("</", "<\\/"))
    run.store.paths.watch.write_text(page, "utf-8")
    return run.store.paths.watch


def _template() -> str:
    return resources.files(__package__).joinpath(_TEMPLATE).read_text("utf-8")


def watch_script() -> str:
    """Return the one script of the page."""
    return _template().partition("<script>")[2].partition("</script>")[0]


def _frames(attempt: AttemptReading, twin: Twin) -> Iterator[dict[str, Any]]:
    """Yield a trial's frames from before the contact until after it."""
    record, force, images = attempt.record, attempt.force, twin.images
    curve = attempt.force_curve
    if curve is None or record.reference_start_ns is None:
        return
    touched = force.stamp_ns[_lasting(curve.value > NO_FORCE_N)]
    if not len(touched):
        return
    before = attempt.recording.frames(record.reference_start_ns, record.reference_end_ns)
    unloaded = [image for image in (images.of(each.jpeg) for each in before) if image is not None]
    if not unloaded:
        return
    background = median_image(unloaded)
    twin.follower.unloaded(background)
    start_ns, end_ns = int(touched[0]) - _MARGIN_NS, int(touched[-1]) + _MARGIN_NS
    shown_ns = -math.inf
    for frame in attempt.recording.frames(start_ns, end_ns):
        if frame.stamp_ns - shown_ns < 0.99e9 / FRAMES_PER_S:
            continue
        shown_ns, real = frame.stamp_ns, images.of(frame.jpeg)
        if real is None:
            continue
        measured = float(np.interp(frame.stamp_ns, force.stamp_ns, curve.value))
        touches = touched[0] <= frame.stamp_ns <= touched[-1]
        goal = Goal(stamp_s=frame.stamp_ns * 1e-9, force_n=measured if touches else 0.0)
        row = _row(goal, (frame.stamp_ns - start_ns) * 1e-9, twin, real, background)
        yield row | {"measured_n": measured}


def _lasting(touching: np.ndarray[Any, np.dtype[np.bool_]]) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Return the longest stretch without a gap: a cell's noise touches for a sample or two."""
    stretches, count = label(touching)
    longest = 1 + np.argmax(np.bincount(stretches)[1:]) if count else 1
    return np.asarray(stretches == longest)


def _row(
    goal: Goal, time_s: float, twin: Twin, real: ImageArray, background: ImageArray
) -> dict[str, Any]:
    made = twin.follower.follow(goal)
    maps = maps_of(made)
    residual = contact_residual(real, made.image, background) if made.force_n else None
    return {
        "time_s": round(time_s, 3),
        "force_n": made.force_n,
        "error_n": made.force_error_n,
        "depth_mm": 1e3 * made.depth_m,
        "residual": residual,
        **{f"{name}_kpa": most_kpa for name, (most_kpa, _) in maps.items()},
        "note": made.note,
        "real": data_url(jpeg_of(real)),
        "twin": data_url(jpeg_of(made.image)),
        **{name: data_url(drawn) for name, (_, drawn) in maps.items()},
    }
