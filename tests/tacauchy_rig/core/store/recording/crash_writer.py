"""Record until killed, saying after each write how many messages are acknowledged.

Usage: crash_writer.py PATH paced|fast|closing
"""

import os
import random
import sys
import time
from pathlib import Path

from tacauchy_rig.core.run import ForceSample, ImageFrame
from tacauchy_rig.core.store.recording.mcap_writer import RecordingWriter

FRAME_BYTES = 840_000
FORCE_PER_FRAME = 4


def jpeg_of(counter: int) -> bytes:
    """Return bytes that follow from the frame's counter."""
    block = random.Random(counter).randbytes(1000)  # noqa: S311
    return block * (FRAME_BYTES // len(block))


def force_of(counter: int) -> ForceSample:
    """Return a force sample that follows from its counter."""
    wrench = (counter / 3, 0.0, 1.0, 0.0, 0.0, 0.0)
    return ForceSample(stamp_ns=1 + counter * 10_000_000, counter=counter, wrench=wrench)


def frame_of(counter: int) -> ImageFrame:
    """Return a frame that follows from its counter."""
    return ImageFrame(
        stamp_ns=1 + counter * 40_000_000,
        counter=counter,
        device_stamp_s=None,
        width=3280,
        height=2464,
        jpeg=jpeg_of(counter),
    )


def main(path: Path, mode: str) -> None:
    """Record 100 Hz force and 25 fps images, in real time or as fast as it goes."""
    writer = RecordingWriter(path, metadata={"mode": mode})
    counter = 0
    while mode != "closing" or counter < 40:
        if counter % FORCE_PER_FRAME == 0:
            writer.write([frame_of(counter // FORCE_PER_FRAME)])
            os.write(1, b"%d\n" % writer.message_count)
        writer.write([force_of(counter)])
        os.write(1, b"%d\n" % writer.message_count)
        counter += 1
        if mode == "paced":
            time.sleep(0.01)
    writer.close()
    os.write(1, b"%d\n" % writer.message_count)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
