"""The state of the arm that emulator processes share."""

import signal
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.emulators.shared_world import WORLD_FILE, SharedWorld
from tacauchy_rig.core.errors import DeviceError
from tacauchy_rig.core.run import Pose

_number = st.floats(allow_nan=False, allow_infinity=False)
_vector = st.tuples(_number, _number, _number)

_WRITE_FOR_EVER = """
import sys
from pathlib import Path
from drivers.emulators.shared_world import SharedWorld
from tacauchy_rig.core.run import Pose

world = SharedWorld(Path(sys.argv[1]))
print("ready", flush=True)
count = 0
while True:
    count += 1
    v = float(count)
    world.publish(Pose(position=(v, v, v), rotation_vector=(v, v, v)), count)
"""


@settings(max_examples=50)
@given(position=_vector, rotation=_vector, stamp_ns=st.integers(0, 2**63 - 1))
def test_any_state_survives_the_file(
    position: tuple[float, float, float],
    rotation: tuple[float, float, float],
    stamp_ns: int,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    """A reader that opened the file by itself sees the newest state: any finite pose and stamp."""
    path = tmp_path_factory.getbasetemp() / "any-state.bin"
    with closing(SharedWorld.create(path)) as writer, closing(SharedWorld(path)) as reader:
        before = reader.read().sequence
        pose = Pose(position=position, rotation_vector=rotation)
        writer.publish(pose, stamp_ns)
        assert reader.read() == (pose, stamp_ns, before + 1)


def test_no_state_is_torn_and_a_killed_writer_leaves_one(tmp_path: Path) -> None:
    """A writer at full speed, then killed, never shows a mixture of two states."""
    path = tmp_path / WORLD_FILE
    reader = SharedWorld.create(path)
    with subprocess.Popen(
        [sys.executable, "-c", _WRITE_FOR_EVER, str(path)], stdout=subprocess.PIPE
    ) as writer:
        assert writer.stdout is not None
        writer.stdout.readline()
        sequences = []
        end_s = time.monotonic() + 0.5
        while time.monotonic() < end_s:
            state = reader.read()
            assert {*state.pose.as_vector()} == {float(state.stamp_ns)}
            sequences.append(state.sequence)
        writer.send_signal(signal.SIGKILL)
    assert sequences == sorted(sequences)
    last = reader.read()
    assert last.sequence >= sequences[-1] > 100
    # Somebody else takes over where the dead writer stopped.
    heir = SharedWorld.create(path)
    heir.publish(last.pose, last.stamp_ns + 1)
    assert reader.read().sequence == last.sequence + 1


def test_a_damaged_state_is_refused(tmp_path: Path) -> None:
    """A file that was damaged is named, with what to do, and no pose is made of it."""
    path = tmp_path / WORLD_FILE
    SharedWorld.create(path).close()
    path.write_bytes(path.read_bytes()[::-1])
    with pytest.raises(DeviceError, match="the file was damaged"):
        SharedWorld(path).read()


def test_refuses_another_file(tmp_path: Path) -> None:
    """An absent or foreign file is named, with what to do."""
    with pytest.raises(DeviceError, match=r"world.bin: absent"):
        SharedWorld(tmp_path / WORLD_FILE)
    (tmp_path / WORLD_FILE).write_text("something else")
    with pytest.raises(DeviceError, match="start the emulated devices"):
        SharedWorld(tmp_path / WORLD_FILE)
