"""What the page is told, put together from feeds and events."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from protocols.processes.child_process import AFTERWARDS, CONTROL_ENDED
from protocols.processes.ipc import Job, Shown
from protocols.processes.page.page_state import TRACE_SAMPLES, StreamView, View
from protocols.processes.page.server import WIDEST_PX, reduced
from protocols.trials.trial_sequence import plan_session
from tacauchy_rig.core.image_codec import media_type
from tacauchy_rig.core.run import ImageFrame, JournalEvent, Outcome, TrialRecord
from tacauchy_rig.core.store.journal import append_event
from tacauchy_rig.core.store.recording.mcap_writer import RecordingWriter
from tests.tacauchy_rig.core.store.test_trusted_force import keep
from tests.tacauchy_rig.core.test_force_sensor_gain import RIGHT, pressed

NAME = "any"


@pytest.fixture
def store(make_store):
    """A run of six trials."""
    return make_store()


@pytest.fixture
def view(store):
    """A view of it."""
    return View(job_of(store))


def job_of(store, *, again=False):
    """Return what the page's process is told."""
    return Job(
        root=store.paths.root,
        config=store.config,
        plan=plan_session(store),
        descriptors={},
        options={"token": NAME},
        again=again,
    )


def event(name, trial=0, **detail):
    """Return an event."""
    return JournalEvent(stamp_ns=10**9, name=name, trial=trial, attempt=1, detail=detail)


def force(first, count, *, is_tared=True):
    """Return force samples as control shows them."""
    counters = list(range(first, first + count))
    return Shown(
        stream="force",
        stamp_ns=counters[-1] * 10_000_000,
        numbers={
            "stamp_ns": [n * 10_000_000 for n in counters],
            "counter": counters,
            "force_n": [0.001 * n for n in counters],
            "wrench": [0.0] * 6,
            "is_tared": is_tared,
        },
    )


def test_a_browser_gets_each_sample_once(view):
    """What is new since the last time; a fresh one gets all that is kept, an absent one no more."""
    view.take(force(0, 1, is_tared=False))  # before the first tare nobody knows a force
    assert view.live(0)[0]["trace"] == []
    view.take(force(1, 5))
    first, drawn = view.live(0)
    view.take(force(6, 3))
    second, drawn = view.live(drawn)
    third, _ = view.live(drawn)
    assert [len(live["trace"]) for live in (first, second, third)] == [5, 3, 0]
    assert (first["from_start"], second["from_start"]) == (True, False)
    assert len(view.live(0)[0]["trace"]) == 8
    for start in range(11, 2 * TRACE_SAMPLES, 10):
        view.take(force(start, 10))
    assert len(view.live(drawn)[0]["trace"]) == TRACE_SAMPLES


def test_everything_told_is_json(view):
    """Also before the first sample, and with numbers that were never measured."""
    for told in (view.setup(), view.run(), view.live(0)[0]):
        json.dumps(told, allow_nan=False)


def test_pictures_are_kept_by_what_the_arm_did(view):
    """The last one without contact, and the last one held of each trial."""
    frame = Shown(stream="camera", stamp_ns=1, numbers={"counter": 1}, picture=b"before")
    view.note(event("attempt-start", 2, force_target_n=1.0))
    view.note(event("phase", 2, phase="reference"))
    view.take(frame)
    view.note(event("phase", 2, phase="dwell"))
    view.take(Shown(stream="camera", stamp_ns=2, numbers={"counter": 2}, picture=b"held"))
    assert view.picture("reference") == b"before"
    assert view.picture("trial-2") == view.picture("camera") == b"held"
    assert view.picture("../rig.toml") is None
    assert view.run()["trials"][1]["has_picture"]


def test_a_view_that_is_made_anew_knows_what_happened(store):
    """From the journal of the run: the trial, its target, the phase."""
    for each in (
        event("run-start"),
        event("attempt-start", 3, force_target_n=2.6466),
        event("phase", 3, phase="press"),
    ):
        append_event(store.paths.journal, each)
    told = View(job_of(store, again=True)).run()
    assert (told["trial"], told["target_n"], told["phase"]) == (3, 2.6466, "press")


def test_a_resumed_run_does_not_begin_with_the_end_of_an_earlier_session(store):
    """Its stop would be switched off."""
    for each in (event("run-start"), event("run-end", outcome="fault", reason="a cable")):
        append_event(store.paths.journal, each)
    assert not View(job_of(store)).ended
    again = View(job_of(store, again=True))
    again.note(event("run-start"))
    assert (again.ended, again.run()["outcome"]) == (False, "")


def test_what_is_done_with_a_recorded_run_is_told(view):
    """From the end of control on: finishing, how it ended, analysing, the report's verdict."""
    view.note(event(CONTROL_ENDED))
    assert view.run()["phase"] == "closing"
    view.note(event("run-end", outcome="aborted", reason="a key was pressed"))
    assert (view.run()["outcome"], view.run()["reason"]) == ("aborted", "a key was pressed")
    view.note(event(AFTERWARDS, state="analysing", text="meshing", passed=None))
    told = view.run()
    assert (told["ended"], told["afterwards"]["state"]) == (True, "analysing")
    assert view.report() is None
    view.note(event(AFTERWARDS, state="reported", text="Not passed.", passed=False))
    assert view.is_reported
    assert [each["name"] for each in told["journal"]] == ["run-end"]


def test_an_arm_is_made_safe_before_it_has_stopped(view):
    """The event comes once it is safe; until then progress says so."""
    view.note(event("phase", 1, phase="press"))
    view.note(event("progress", 1, phase="fault"))
    assert view.run()["phase"] == "fault"
    view.note(event("fault", 1, reason="limits.soft_force"))
    assert (view.run()["phase"], view.run()["reason"]) == ("stopped", "limits.soft_force")


def test_after_a_resume_earlier_trials_have_pictures_and_the_running_one_no_old_outcome(store):
    """The last frame of the dwell, out of the recording; an attempt that is cut off counts less."""
    frames = [
        ImageFrame(stamp_ns=n, counter=n, device_stamp_s=None, width=4, height=3, jpeg=b"%d" % n)
        for n in range(1, 6)
    ]
    store.paths.attempt(1, 1).mkdir(parents=True)
    with RecordingWriter(store.paths.recording(1, 1), metadata={}) as writer:
        writer.write(frames)
    done = TrialRecord(
        index=1,
        attempt=1,
        outcome=Outcome.PASSED,
        force_target_n=1.0,
        dwell_start_ns=2,
        dwell_end_ns=4,
    )
    store.save_result(done)
    store.save_result(replace(done, index=2, outcome=Outcome.ABORTED, dwell_end_ns=None))
    view = View(job_of(store))
    first, second = view.run()["trials"][:2]
    assert (first["has_picture"], view.picture("trial-1")) == (True, b"4")
    assert (second["outcome"], second["has_picture"]) == ("aborted", False)
    begun = replace(event("attempt-start", 2, force_target_n=1.0), attempt=2)
    view.note(begun)
    assert "outcome" not in view.run()["trials"][1]
    view.note(replace(begun, name="attempt-end"))
    assert view.run()["trials"][1]["outcome"] == "aborted"


def test_a_gap_of_counters_is_a_loss():
    """Counted once; a stream that begins anew is none."""
    stream = StreamView()
    stream.take(1, count=3, counters=(1, 2, 3))
    stream.take(2, count=2, counters=(6, 7))
    stream.take(3, count=1, counters=(1,))
    assert stream.summary(3)["lost"] == 2


def test_a_large_picture_is_made_smaller_and_others_are_left_alone():
    """A page needs no camera's full size; what is no JPEG passes as it is."""
    large = cv2.imencode(".jpg", np.zeros((2464, 3280, 3), np.uint8))[1].tobytes()
    decoded = cv2.imdecode(np.frombuffer(reduced(large), np.uint8), cv2.IMREAD_COLOR)
    assert WIDEST_PX / 2 <= decoded.shape[1] <= WIDEST_PX
    small = cv2.imencode(".jpg", np.zeros((48, 64, 3), np.uint8))[1].tobytes()
    assert reduced(small) is small
    assert reduced(b"\x89PNG...") == b"\x89PNG..."
    assert (media_type(b"\x89PNG"), media_type(small)) == ("image/png", "image/jpeg")


def test_a_trial_that_is_doubted_at_the_end_is_shown_as_failed(view, store):
    """It passed, and the same force sensor was found faulty afterwards."""
    first, second, *_ = pressed(RIGHT)
    keep(store, first, replace(second, outcome=Outcome.FAULT, limit="witness.gel", reason="sunk"))
    view.note(event("run-end", outcome="fault", reason="sunk"))
    row = view.run()["trials"][0]
    assert row["outcome"] == "failed"
    assert row["reason"].startswith("sunk: ")
    assert not row["checks"][-1]["passed"]
