"""A producer's way to the recorder: acknowledged, or spilled."""

import os
import pickle
import socket

import pytest

from protocols.control.cycle import Begin, End
from protocols.processes import recorder_process as link_module
from protocols.processes.ipc import Ack, Channel
from protocols.processes.recorder_process import BETWEEN_ATTEMPTS, RecorderLink
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import ForceSample, JournalEvent, Outcome, TrialRecord
from tacauchy_rig.core.store.journal import Journal, append_event
from tacauchy_rig.core.store.recording.mcap_reader import Recording


def force(counter):
    """Return an entry with one sample."""
    wrench = (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    return (ForceSample(stamp_ns=counter * 10, counter=counter, wrench=wrench),)


class FarEnd:
    """The recorder's end of a link, moved by hand."""

    def __init__(self, store):
        self.data, data = socket.socketpair()
        self.acks, acks = Channel.pair()
        self.stream = self.data.makefile("rb")
        self.told = []
        ends = {"recorder-data": data.detach(), "recorder-acks": os.dup(acks.fileno())}
        acks.close()
        self.link = RecorderLink(ends, store=store, source="control", on_attempt=self.told.append)

    def take(self, count):
        """Receive ``count`` entries."""
        self.data.settimeout(5.0)
        return [pickle.load(self.stream) for _ in range(count)]  # noqa: S301

    def acknowledge(self, through, *, kept=0):
        """Say that everything up to ``through`` is on disk."""
        self.acks.send(Ack(through=through, kept_count=kept))

    def die(self):
        """End as a killed process does."""
        self.stream.close()
        self.data.close()
        self.acks.close()


@pytest.fixture
def far(make_store):
    """Return a recorder's end with its link in ``.link``."""
    far = FarEnd(make_store())
    yield far
    far.die()
    far.link.close(timeout_s=1.0)


def test_acknowledged_entries_are_forgotten(far):
    """After the last acknowledgement nothing waits and closing leaves no spill."""
    for entry in (Begin(1, 1), force(1), force(2)):
        far.link.put(entry)
    assert [number for number, _ in far.take(3)] == [1, 2, 3]
    far.acknowledge(3, kept=2)
    assert far.acks.closed is False
    far.link.close(timeout_s=2.0)
    assert far.link.kept == Ack(through=3, kept_count=2)
    assert far.link.problem() == ""
    assert not list(far.link._store.paths.trials.rglob("unacknowledged*"))


def test_what_a_dead_recorder_left_is_spilled(far):
    """Entries without acknowledgement, and those that follow, go to a file of their own."""
    store = far.link._store
    for entry in (Begin(1, 1), force(1), force(2), force(3)):
        far.link.put(entry)
    far.take(4)
    far.acknowledge(2, kept=1)
    far.link.poll()
    far.die()
    far.link.poll()
    assert "process is gone" in far.link.problem()
    far.link.put(force(4))
    far.link.put(End(_record(), 100))
    far.link.close(timeout_s=4.0)
    spill = Recording.open(store.paths.spill(1, 1, "control"))
    assert spill.force.counter.tolist() == [2, 3, 4]
    assert store.load_result(1, 1) == _record()


def test_what_is_spilled_belongs_to_the_attempt_of_its_entries(far):
    """A recorder that stalls in trial 2 last acknowledged entries of trial 1."""
    store = far.link._store
    for entry in (Begin(1, 1), force(1), End(_record(), 15), force(2), Begin(2, 1), force(3)):
        far.link.put(entry)
    far.take(6)
    far.acknowledge(2, kept=1)
    far.link.poll()
    far.die()
    far.link.close(timeout_s=4.0)
    assert Recording.open(store.paths.spill(2, 1, "control")).force.counter.tolist() == [3]
    assert not store.paths.spill(1, 1, "control").exists()
    assert store.load_result(1, 1) == _record()


def test_the_camera_is_told_which_attempt_its_frames_belong_to(far):
    """It sees no beginning and no end itself."""
    for entry in (Begin(2, 1), force(1), End(_record(), 15)):
        far.link.put(entry)
    assert far.told == [Begin(2, 1), BETWEEN_ATTEMPTS]
    far.acknowledge(3, kept=1)


def test_journal_lines_are_not_written_twice(far):
    """A line that the recorder wrote before it died is not repeated by the spill."""
    store = far.link._store
    events = [JournalEvent(stamp_ns=n, name="phase", trial=1, attempt=1) for n in (1, 2)]
    append_event(store.paths.journal, events[0])
    far.link.put(Begin(1, 1))
    for event in events:
        far.link.put(event)
    far.die()
    far.link.close(timeout_s=4.0)
    assert Journal.read(store.paths.journal).events == events


def test_a_recorder_that_hangs_is_noticed(far, monkeypatch):
    """No answer for too long is a problem, and its entries are spilled on closing."""
    monkeypatch.setattr(link_module, "STALLED_S", 0.05)
    far.link.put(Begin(1, 1))
    far.link.put(force(1))
    far.take(2)
    while not far.link.problem():
        far.acks.wait(0.02)
    assert "acknowledged nothing" in far.link.problem()
    far.link.close(timeout_s=2.0)
    spill = Recording.open(far.link._store.paths.spill(1, 1, "control"))
    assert spill.force.counter.tolist() == [1]


def test_a_full_disk_is_told_in_the_recorder_s_words(far):
    """What the recorder says before it gives up becomes the problem."""
    error = RecordError("recording.mcap: no space left on the disk", remedy="free some")
    far.acks.send(error)
    assert "no space left" in far.link.problem()


def _record():
    return TrialRecord(index=1, attempt=1, outcome=Outcome.FAULT, force_target_n=2.0)
