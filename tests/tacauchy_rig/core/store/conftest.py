"""Samples, recordings and faults that the store's tests share."""

import os
import random
import resource
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import pytest

from tacauchy_rig.core.run import ArmSample, ForceSample, ImageFrame, JournalEvent, Pose
from tacauchy_rig.core.store.recording.mcap_writer import RecordingWriter

START_NS = 5_000_000_000
PERIOD_NS = 10_000_000


class Samples:
    """Samples whose content follows from their counter."""

    def force(self, counter: int) -> ForceSample:
        """Return a force sample at 100 Hz."""
        wrench = (0.1, -0.2, counter / 7, 1e-3, 2e-3, -counter / 3)
        return ForceSample(stamp_ns=START_NS + counter * PERIOD_NS, counter=counter, wrench=wrench)

    def arm(self, counter: int) -> ArmSample:
        """Return a state of the arm at 100 Hz; the odd ones have no force of its own."""
        return ArmSample(
            stamp_ns=START_NS + counter * PERIOD_NS,
            controller_time_s=counter / 500,
            pose=Pose(position=(0.0, -0.4, 0.2 - counter / 9e6), rotation_vector=(0.0, 3.1, 0.0)),
            velocity=(0.0, 0.0, -3e-4, 0.0, 0.0, 1e-9),
            runtime_state=2,
            safety_bits=1,
            robot_mode=7,
            tcp_force=None if counter % 2 else (0.0, -0.0, counter / 11, 1e-3, 0.0, 0.0),
        )

    def frame(self, counter: int, *, size: int = 5_000) -> ImageFrame:
        """Return a frame at 25 fps with ``size`` bytes for its JPEG."""
        return ImageFrame(
            stamp_ns=START_NS + 4 * counter * PERIOD_NS,
            counter=counter,
            device_stamp_s=None if counter % 2 else counter / 25,
            width=640,
            height=480,
            jpeg=random.Random(counter).randbytes(size),  # noqa: S311
        )

    def event(self, counter: int) -> JournalEvent:
        """Return a journal event."""
        detail = {"phase": "press", "count": counter, "nested": {"depth_m": 1e-3}}
        return JournalEvent(
            stamp_ns=START_NS + counter * PERIOD_NS, name="phase", trial=1, attempt=2, detail=detail
        )

    def write(self, writer: RecordingWriter, count: int) -> None:
        """Write ``count`` frames with four force samples and arm states each, and one event."""
        for number in range(count):
            writer.write([self.frame(number)])
            writer.write([self.force(4 * number + part) for part in range(4)])
            writer.write([self.arm(4 * number + part) for part in range(4)])
        writer.write([self.event(0)])


@pytest.fixture(scope="session")
def samples() -> Samples:
    """Return the factory of samples."""
    return Samples()


@pytest.fixture
def finished(tmp_path: Path, samples: Samples) -> Path:
    """Return a finished recording: 10 frames, 40 force samples, 40 arm states, 1 event."""
    path = tmp_path / "trials" / "01" / "attempt-1" / "recording.mcap"
    with RecordingWriter(path, metadata={"trial": "1"}) as writer:
        samples.write(writer, 10)
    return path


@pytest.fixture
def file_size_limit() -> Callable[[int], AbstractContextManager[None]]:
    """Return a context in which no file may grow beyond so many bytes: a disk that is full."""

    @contextmanager
    def limited(size: int) -> Iterator[None]:
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)

    return limited


@pytest.fixture
def unprivileged() -> Iterator[None]:
    """Give up root's rights for a test, where the tests run as root."""
    user = os.geteuid()
    if user == 0:
        os.seteuid(65534)
    yield
    os.seteuid(user)
