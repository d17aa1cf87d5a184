"""The process that publishes a run: no other process waits for it, and it takes no requests."""

import logging
import os
import select
import sys
import time
from collections.abc import Sequence
from typing import Any

import foxglove
from foxglove.channels import CompressedImageChannel, PoseInFrameChannel
from foxglove.messages import CompressedImage, Pose, PoseInFrame, Quaternion, Timestamp, Vector3

from protocols.processes.child_process import LOOPBACK, PRODUCERS, ignore_signals, run_child
from protocols.processes.ipc import Channel, Job, Order, Shown, feed_readers
from protocols.trials.trial_sequence import PlannedTrial
from tacauchy_rig.app.viewers.foxglove_options import PORT, SOURCES, address
from tacauchy_rig.core.rotations import quaternion
from tacauchy_rig.core.run import JournalEvent

AXES = ("force_x_n", "force_y_n", "force_z_n", "torque_x_nm", "torque_y_nm", "torque_z_nm")
BASE_FRAME, CAMERA_FRAME = "robot_base", "sensor_camera"
IMAGES = {
    "camera": "/camera/image",
    "twin": "/twin/image",
    "twin pressure": "/twin/pressure",
    "twin shear": "/twin/shear",
}
"""Topics of a feed's pictures."""


class Topics:
    """Publishes a run under its own clock's times.

    Args:
        plan: Of the session, for targets.
        context: Whom it is published to; None is every server of this process.
    """

    def __init__(
        self, plan: Sequence[PlannedTrial], context: foxglove.Context | None = None
    ) -> None:
        self._targets = {each.index: each.force_target_n for each in plan}
        # Stamps are the monotonic clock's, which viewers do not know.
        self._since_ns = time.time_ns() - time.monotonic_ns()
        self._trial, self._phase = 0, ""
        numbers = {
            "/force": ("pressing_n", "target_n"),
            "/wrench": AXES,
            "/twin": ("force_n", "force_error_n", "depth_mm", "lag_ms", "residual"),
        }
        self._numbers = {
            topic: foxglove.Channel(
                topic, schema=_schema(topic, dict.fromkeys(names, "number")), context=context
            )
            for topic, names in numbers.items()
        }
        words = {"trial": "integer", "phase": "string", "event": "string"}
        self._run = foxglove.Channel("/run", schema=_schema("/run", words), context=context)
        self._arm = PoseInFrameChannel("/arm/tip", context=context)
        self._images = {
            stream: CompressedImageChannel(topic, context=context)
            for stream, topic in IMAGES.items()
        }

    def show(self, shown: Shown) -> None:
        """Publish what a feed shows."""
        if shown.stream == "force":
            self._force(shown.numbers)
        elif shown.stream == "arm":
            w, x, y, z = quaternion(shown.numbers["rotation_rad"])
            place = Vector3(**dict(zip("xyz", shown.numbers["position_m"], strict=True)))
            pose = Pose(position=place, orientation=Quaternion(x=x, y=y, z=z, w=w))
            at_ns = self._at_ns(shown.stamp_ns)
            tip = PoseInFrame(timestamp=_stamp(at_ns), frame_id=BASE_FRAME, pose=pose)
            self._arm.log(tip, log_time=at_ns)
        elif shown.stream == "twin":
            message = {name: value for name, value in shown.numbers.items() if name != "note"}
            self._log("/twin", message, shown.stamp_ns)
        if shown.picture is not None and shown.stream in self._images:
            self._picture(shown)

    def note(self, event: JournalEvent) -> None:
        """Publish an event of the journal."""
        self._trial = event.trial or self._trial
        if event.name == "phase":
            self._phase = str(event.detail.get("phase", ""))
        message = {"trial": self._trial, "phase": self._phase, "event": event.name}
        self._run.log(message, log_time=self._at_ns(time.monotonic_ns()))

    def _force(self, numbers: dict[str, Any]) -> None:
        target = self._targets.get(self._trial)
        for stamp_ns, force_n in zip(numbers["stamp_ns"], numbers["force_n"], strict=True):
            message = {"pressing_n": force_n}
            self._log(
                "/force", message if target is None else {**message, "target_n": target}, stamp_ns
            )
        axes = dict(zip(AXES, numbers["wrench"], strict=True))
        self._log("/wrench", axes, numbers["stamp_ns"][-1])

    def _picture(self, shown: Shown) -> None:
        data, at_ns = shown.picture or b"", self._at_ns(shown.stamp_ns)
        kind = "png" if data.startswith(b"\x89PNG") else "jpeg"
        picture = CompressedImage(
            timestamp=_stamp(at_ns), frame_id=CAMERA_FRAME, data=data, format=kind
        )
        self._images[shown.stream].log(picture, log_time=at_ns)

    def _log(self, topic: str, numbers: dict[str, Any], stamp_ns: int) -> None:
        self._numbers[topic].log(numbers, log_time=self._at_ns(stamp_ns))

    def _at_ns(self, stamp_ns: int) -> int:
        return stamp_ns + self._since_ns


def _stamp(at_ns: int) -> Timestamp:
    return Timestamp(sec=at_ns // 10**9, nsec=at_ns % 10**9)


def _schema(topic: str, kinds: dict[str, str]) -> dict[str, Any]:
    """Return a JSON schema; the unit of a number is the end of its name."""
    return {
        "type": "object",
        "title": f"tacauchy_rig.{topic.strip('/')}",
        "properties": {name: {"type": kind} for name, kind in kinds.items()},
    }


logger = logging.getLogger(__name__)

NICENESS = 10
ALIVE_S = 0.5


def publish(job: Job, supervisor: Channel) -> None:
    """Do the job."""
    ignore_signals()
    os.nice(NICENESS)
    port = int(job.options[PORT])
    # Without capabilities and services a viewer can neither publish, nor set, nor call anything.
    server = foxglove.start_server(
        name="tacauchy-rig", host=LOOPBACK, port=port, capabilities=[], services=[]
    )
    logger.info("publishing at %s", address(port))
    topics = Topics(job.plan)
    readers = feed_readers(job.descriptors, (*PRODUCERS, *SOURCES))
    waiting = [supervisor.fileno(), *(reader.fileno() for reader in readers)]
    told_s = 0.0
    try:
        while not supervisor.closed:
            if time.monotonic() - told_s > ALIVE_S:
                told_s = time.monotonic()
                supervisor.send(Order.ALIVE)
            select.select(waiting, [], [], ALIVE_S)
            for reader in readers:
                for shown in reader.receive():
                    topics.show(shown)
            for message in supervisor.receive():
                if message is Order.STOP:
                    return
                if isinstance(message, JournalEvent):
                    topics.note(message)
    finally:
        server.stop()


if __name__ == "__main__":
    sys.exit(run_child("foxglove", publish))
