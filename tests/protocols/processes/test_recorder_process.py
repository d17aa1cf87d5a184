"""The recorder's order of work, without a process."""

import hashlib
import pickle
import socket
from dataclasses import replace

import pytest

from protocols.control.cycle import Begin, End
from protocols.processes.ipc import Channel
from protocols.processes.recorder_process import Producer, Recorder, RecordKeeper, encoded
from tacauchy_rig.core.run import ImageFrame, Outcome, TrialRecord
from tacauchy_rig.core.store.recording.mcap_reader import Recording

RECORD = TrialRecord(index=1, attempt=1, outcome=Outcome.PASSED, force_target_n=2.0)


def frame(stamp_ns):
    """Return a frame entry."""
    made = ImageFrame(
        stamp_ns=stamp_ns,
        counter=stamp_ns,
        device_stamp_s=None,
        width=4,
        height=4,
        jpeg=b"\xff\xd8\xff\xd9",
    )
    return (made,)


class Desk:
    """A recorder with two producers that a test speaks for."""

    def __init__(self, store):
        self.store = store
        self.sockets, self.acks, self.producers, self.numbers = {}, {}, {}, {}
        for name in ("control", "camera"):
            self.sockets[name], data = socket.socketpair()
            self.acks[name], acks = Channel.pair()
            self.producers[name] = Producer(name, data, acks)
            data.close()
            self.numbers[name] = 0
        self.recorder = Recorder(RecordKeeper(store), list(self.producers.values()))

    def say(self, name, entry):
        """Let a producer send an entry and the recorder take it."""
        self.numbers[name] += 1
        self.sockets[name].sendall(pickle.dumps((self.numbers[name], encoded(entry))))
        self.producers[name].read()
        self.recorder.step()

    def sealed_record(self):
        """Return the record with the hash of the recording that lies on the disk."""
        recorded = self.store.paths.recording(1, 1).read_bytes()
        return replace(RECORD, recording_sha256=hashlib.sha256(recorded).hexdigest())

    def acknowledged(self, name):
        """Return the newest acknowledged number."""
        return self.acks[name].receive()[-1].through


@pytest.fixture
def desk(make_store):
    """Return a desk."""
    desk = Desk(make_store())
    yield desk
    for name in ("control", "camera"):
        desk.sockets[name].close()
        desk.producers[name]._stream.close()
        desk.acks[name].close()
        desk.producers[name].acks.close()


def test_an_attempt_ends_when_its_last_frames_are_in(desk):
    """The end is held back until a frame later than it has come, so none of them is lost."""
    desk.say("control", Begin(1, 1))
    desk.say("camera", frame(10))
    desk.say("control", End(RECORD, 25))
    assert desk.acknowledged("control") == 1
    desk.say("camera", frame(20))
    assert desk.store.load_result(1, 1) is None
    desk.say("camera", frame(30))
    desk.recorder.step()
    assert desk.store.load_result(1, 1) == desk.sealed_record()
    assert desk.acknowledged("control") == 2
    stamps, _ = Recording.open(desk.store.paths.recording(1, 1)).frame_stamps()
    assert stamps.tolist()[:2] == [10, 20]


def test_frames_between_attempts_are_acknowledged_but_not_kept(desk):
    """The camera may forget them; they belong to no recording."""
    desk.say("camera", frame(5))
    ack = desk.acks["camera"].receive()[-1]
    assert (ack.through, ack.kept_count) == (1, 0)


def test_a_camera_killed_in_the_middle_of_a_frame_does_not_hold_an_attempt_back(desk):
    """With its stream at an end nothing more is waited for, and half a frame is none."""
    desk.say("control", Begin(1, 1))
    desk.say("camera", frame(10))
    desk.sockets["camera"].sendall(pickle.dumps((2, frame(20)))[:-1])
    desk.sockets["camera"].close()
    assert not desk.producers["camera"].read()
    desk.say("control", End(RECORD, 25))
    assert desk.store.load_result(1, 1) == desk.sealed_record()
