"""The camera process looks at the light once a second, and control learns of it."""

from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from protocols.control.cycle import Begin
from protocols.processes.camera_process import EXPOSURE_S, ExposureWatch, MarkSender
from protocols.processes.ipc import Channel
from protocols.processes.recorder_process import RemoteCamera
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.run import ImageFrame
from tests.mock.bench import SimulatedClock
from tests.mock.streams import MockCamera
from tests.mock.world import MockWorld

SECOND_NS = round(EXPOSURE_S * 1e9)


def frame(stamp_ns: int, level: int | None) -> ImageFrame:
    """Return a plain frame of one grey level; None is damaged."""
    image = np.full((48, 64, 3), level or 0, np.uint8)
    data = b"damaged" if level is None else cv2.imencode(".jpg", image)[1].tobytes()
    return ImageFrame(
        stamp_ns=stamp_ns, counter=1, device_stamp_s=None, width=64, height=48, jpeg=data
    )


@pytest.mark.parametrize(
    ("looks", "ratio"),
    [
        ([(5 * SECOND_NS, 255)], 1.0),
        ([(5 * SECOND_NS, 128)], 0.0),
        ([(5 * SECOND_NS, 128), (5 * SECOND_NS + SECOND_NS // 2, 255)], 0.0),
        ([(5 * SECOND_NS, 128), (6 * SECOND_NS, 255)], 1.0),
        ([(5 * SECOND_NS, 255), (6 * SECOND_NS, None)], 1.0),
        ([(5 * SECOND_NS, 255), (6 * SECOND_NS, 128)], 0.0),
    ],
)
def test_one_image_a_second_is_judged(looks: list[tuple[int, int | None]], ratio: float) -> None:
    """Those between are passed over; one that cannot be read changes nothing."""
    watch = ExposureWatch()
    watch.judge([])
    for stamp_ns, level in looks:
        watch.judge([frame(stamp_ns, level)])
    assert watch.clipped_ratio == ratio


def test_control_learns_what_the_camera_process_saw(config: RigConfig) -> None:
    """Nothing of the stream's health is left behind between the two, only its age is control's."""
    ours, theirs = Channel.pair()
    camera, remote = MockCamera(MockWorld(SimulatedClock(), config)), RemoteCamera(theirs)
    camera.connect()
    try:
        link = SimpleNamespace(attempt=None)
        sender = MarkSender(ours, link)
        sender.send([frame(5 * SECOND_NS, 255)], camera)
        assert [mark.stamp_ns for mark in remote.poll()] == [5 * SECOND_NS]
        expected = replace(camera.health(), clipped_ratio=1.0)
        assert replace(remote.health(), age_s=expected.age_s) == expected
        remote.ask(Begin(2, 1))
        sender.take_requests()
        assert link.attempt == Begin(2, 1)
    finally:
        ours.close()
        theirs.close()
