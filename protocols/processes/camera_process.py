"""The camera process: frames go straight to the recorder, small marks of them to control."""

from __future__ import annotations

import logging
import sys
import time
import zlib
from dataclasses import replace

from drivers.camera.frame_checks import TouchWatch, clipped_ratio
from drivers.interfaces import Camera, FrameMark, TouchMode, build_camera
from protocols.control.cycle import Begin
from protocols.processes.child_process import ask_for_priority, ignore_signals, run_child
from protocols.processes.ipc import VIEWERS, CameraStatus, Channel, FeedWriters, Job, Order, Ready
from protocols.processes.recorder_process import RecorderLink
from tacauchy_rig.core.errors import DeviceError
from tacauchy_rig.core.run import ImageFrame
from tacauchy_rig.core.store.run_store import RunStore

logger = logging.getLogger(__name__)

NICENESS = -5
POLL_S = 0.005
EXPOSURE_S = 1.0
REPORT_S = 0.1
ORPHAN_S = 20.0
MARKS_MAX = 1000
CLOSE_S = 4.0


def film(job: Job, supervisor: Channel) -> None:
    """Do the camera's job."""
    ignore_signals()
    ask_for_priority(NICENESS)
    control = Channel.inherited(job.descriptors["control-status"])
    camera = build_camera(job.config)
    identity = camera.connect()
    link = RecorderLink(job.descriptors, store=RunStore.open(job.root), source="camera")
    marks, feeds = MarkSender(control, link), FeedWriters(job.descriptors, VIEWERS)
    supervisor.send(Ready(devices={"camera": identity}))
    try:
        _run_camera(camera, link, marks, feeds, supervisor)
    finally:
        camera.close()
        link.close(timeout_s=CLOSE_S)
        supervisor.send(link.kept)


def _run_camera(
    camera: Camera, link: RecorderLink, marks: MarkSender, feeds: FeedWriters, supervisor: Channel
) -> None:
    alive, reported_s = True, 0.0
    orphaned_s: float | None = None
    while Order.STOP not in supervisor.receive():
        now_s = time.monotonic()
        if supervisor.closed:
            # Control still needs the frames of its way to a safe stop.
            orphaned_s = orphaned_s or now_s
            if marks.control.closed or now_s - orphaned_s > ORPHAN_S:
                return
        supervisor.wait(POLL_S) if not supervisor.closed else time.sleep(POLL_S)
        marks.take_requests()
        link.poll()
        if now_s - reported_s > REPORT_S:
            reported_s = now_s
            supervisor.send(link.kept)
        if alive:
            alive = _pass_on(camera, link, marks, feeds)


class ExposureWatch:
    """Judges one image a second: more would cost a computer that has to keep up with the rest."""

    def __init__(self) -> None:
        self._judged_ns = 0
        self.clipped_ratio = 0.0

    def judge(self, frames: list[ImageFrame]) -> None:
        """Take in new frames, the newest last."""
        if frames and frames[-1].stamp_ns - self._judged_ns >= EXPOSURE_S * 1e9:
            self._judged_ns = frames[-1].stamp_ns
            ratio = clipped_ratio(frames[-1].jpeg)
            self.clipped_ratio = self.clipped_ratio if ratio is None else ratio


class MarkSender:
    """Sends marks of frames to control; what control is too busy to take goes with the next."""

    def __init__(self, control: Channel, link: RecorderLink) -> None:
        self.control = control
        self._link = link
        self._marks: list[FrameMark] = []
        self._exposure = ExposureWatch()
        self._touch = TouchWatch()

    def take_requests(self) -> None:
        """Take what control asks the camera to look for, and which attempt runs now."""
        for message in self.control.receive():
            if isinstance(message, TouchMode):
                self._touch.ask(message)
            elif isinstance(message, Begin):
                self._link.attempt = message

    def send(self, frames: list[ImageFrame], camera: Camera) -> None:
        """Tell control of new frames."""
        self._marks += [mark_of(frame, self._touch) for frame in frames]
        self._marks = self._marks[-MARKS_MAX:]
        self._exposure.judge(frames)
        if self._marks:
            health = replace(camera.health(), clipped_ratio=self._exposure.clipped_ratio)
            if self.control.send(CameraStatus(marks=tuple(self._marks), health=health)):
                self._marks.clear()


def mark_of(frame: ImageFrame, touch: TouchWatch) -> FrameMark:
    """Return what control is told of a frame."""
    digest, touched = zlib.crc32(frame.jpeg), touch.see(frame.jpeg)
    return FrameMark(frame.stamp_ns, frame.counter, digest=digest, touched=touched)


def _pass_on(camera: Camera, link: RecorderLink, marks: MarkSender, feeds: FeedWriters) -> bool:
    """Pass new frames on; return False once the camera is gone."""
    try:
        frames = camera.drain()
    except DeviceError as error:
        logger.error("%s", error)
        marks.control.send(error)
        return False
    if frames:
        link.put(tuple(frames))
    marks.send(frames, camera)
    if feeds:
        for frame in frames:
            seen = {"counter": frame.counter, "width_px": frame.width, "height_px": frame.height}
            feeds.show("camera", frame.stamp_ns, seen, frame.jpeg)
    return True


if __name__ == "__main__":
    sys.exit(run_child("camera", film))
