"""The page in a real browser, beside a session on mocks."""

import os
import re
import signal
import time

import pytest

from protocols.processes.child_process import CONTROL_ENDED, Viewing
from protocols.processes.ipc import Job, PageOptions
from protocols.trials.trial_sequence import plan_session
from tacauchy_rig.core.run import JournalEvent, Outcome
from tests.protocols.processes.page.conftest import ONE, running

HEADED = "words => document.getElementById('phase').textContent === words"
STALE = "document.querySelector('#image-card .stale')"


def newest(page):
    """Return the time of the trace's newest sample [s]."""
    return float(page.evaluate("document.getElementById('trace').dataset.newest") or 0.0)


def wait_until_it_moves(page):
    """The trace gets newer."""
    before = newest(page)
    page.wait_for_function(
        "before => Number(document.getElementById('trace').dataset.newest) > before + 0.3",
        arg=before,
    )


def test_the_trace_moves_and_everything_is_told(long_session, tab):
    """Force, axes, arm, streams, image with its outline, trials: all of them are filled."""
    page = tab(long_session.address)
    wait_until_it_moves(page)
    page.wait_for_function("() => document.querySelectorAll('#streams tbody tr').length >= 3")
    page.wait_for_function("() => document.getElementById('image').width !== 300")
    page.wait_for_function("() => document.querySelectorAll('#axes tr').length === 6")
    assert re.fullmatch(r"-?\d+\.\d{3}", page.inner_text("#force"))
    assert page.locator("#axes tr").count() == 6
    assert page.locator("#trials figure").count() == 6
    assert "mm/s" in page.inner_text("#arm")
    assert page.is_visible("#simulated")
    drawn = page.evaluate(
        "[...document.getElementById('trace').getContext('2d')"
        ".getImageData(0, 0, 400, 200).data].some((value) => value > 0)"
    )
    assert drawn


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_phone_shows_it_without_scrolling_sideways(long_session, tab, scheme):
    """390 px wide, in both schemes; the stop is in sight and large."""
    page = tab(long_session.address, viewport={"width": 390, "height": 844}, color_scheme=scheme)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    page.evaluate("window.scrollTo(0, 800)")
    box = page.locator("#stop").bounding_box()
    assert box["y"] >= 0
    assert min(box["width"], box["height"]) >= 44


def test_the_keyboard_alone_reaches_the_stop(long_session, tab):
    """The first press of Tab."""
    page = tab(long_session.address)
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.id") == "stop"


def test_a_stop_halts_the_arm(session, tab):
    """It is the same abort as a key of the terminal: off the gel, exit 3, the record whole."""
    page = tab(session.address)
    session.wait_for("phase", phase="press")
    page.click("#stop")
    result = session.end()
    assert (result.outcome, result.exit_code) == (Outcome.ABORTED, 3)
    assert "stop was pressed on the page" in result.reason
    assert "off the gel" in result.reason
    page.wait_for_function("() => run.ended")
    assert "aborted" in page.inner_text("#alert")


@pytest.mark.slow
def test_a_stop_works_while_the_page_is_throttled(tmp_path, tab):
    """A line of 2 kB/s, on which the events come late: the space bar is not queued behind them."""
    # Held long enough for a busy computer to deliver the key.
    with running(tmp_path, ONE, 'protocol.dwell_duration="10 s"') as session:
        page = tab(session.address)
        wire = page.context.new_cdp_session(page)
        wire.send(
            "Network.emulateNetworkConditions",
            {"offline": False, "latency": 50, "downloadThroughput": 2000, "uploadThroughput": 2000},
        )
        session.wait_for("phase", phase="press")
        page.keyboard.press("Space")
        assert session.end().outcome is Outcome.ABORTED


@pytest.mark.slow
def test_a_frozen_camera_is_marked_within_a_second(tmp_path, tab):
    """What the mark says when it appears is how old the image is by then."""
    overrides = ('emulation.faults=["camera:stall@4s"]', 'limits.stale_image="2 s"')
    with running(tmp_path, *overrides) as session:
        page = tab(session.address)
        told = page.wait_for_function(
            f"() => !{STALE}.hidden && live.streams.camera.age_s !== null && {STALE}.textContent",
            polling="raf",
        ).json_value()
        assert float(re.search(r"for ([\d.]+) s", told)[1]) <= 1.0
        assert page.locator("#image-card.is-stale").count() == 1
        assert page.locator("#force-card.is-stale").count() == 0


@pytest.mark.slow
def test_a_killed_server_costs_the_run_nothing(tmp_path, tab):
    """It is started again at the same address, the browser finds it, and the trial passes."""
    # Held long enough for another server to start on a busy computer.
    with running(tmp_path, ONE, 'protocol.dwell_duration="5 s"') as session:
        page = tab(session.address)
        pid = session.wait_for("run-start")["pids"]["page"]
        session.wait_for("phase", phase="home")
        os.kill(pid, signal.SIGKILL)
        told = session.wait_for("process-died", process="page")["how"]
        assert "started again" in told
        wait_until_it_moves(page)
        result = session.end()
        assert (result.outcome, result.died) == (Outcome.PASSED, {})
        assert result.records[0].rates["force_lost_count"] == 0


@pytest.mark.slow
def test_a_hung_server_costs_the_run_nothing(session, tab):
    """Stopped for good: the page says that it hears nothing, the trial passes."""
    page = tab(session.address)
    pid = session.wait_for("run-start")["pids"]["page"]
    session.wait_for("phase", phase="home")
    os.kill(pid, signal.SIGSTOP)
    page.wait_for_function("() => document.getElementById('alert').dataset.silent === '1'")
    assert "any key in the terminal stops it" in page.inner_text("#alert")
    assert session.end().outcome is Outcome.PASSED


@pytest.mark.slow
def test_the_terminal_stops_while_the_server_hangs(session):
    """An abort of the terminal takes its own way."""
    pid = session.wait_for("run-start")["pids"]["page"]
    session.wait_for("phase", phase="search")
    os.kill(pid, signal.SIGSTOP)
    time.sleep(0.2)
    session.abort.request("a key was pressed")
    result = session.end()
    assert result.outcome is Outcome.ABORTED
    assert "a key was pressed" in result.reason


def test_the_page_tells_what_the_terminal_tells_after_the_arm(make_store, tab):
    """Finishing, analysing, the verdict of the report with a link that outlives the program."""
    store = make_store()
    plan = plan_session(store)
    job = Job(root=store.paths.root, config=store.config, plan=plan, descriptors={})
    viewing = Viewing(PageOptions(), job)
    viewing.start()
    try:
        page = tab(viewing.address)
        viewing.send(JournalEvent.now(CONTROL_ENDED))
        page.wait_for_function(HEADED, arg="finishing the record")
        overrun = JournalEvent.now("air-press", overrun_m=5e-7, drift_n=0.01)
        viewing.send(overrun)
        viewing.send(JournalEvent.now("run-end", outcome="passed", reason=""))
        viewing.tell_page("analysing", "meshing")
        page.wait_for_function(HEADED, arg="recording complete, analysing")
        assert page.inner_text("#alert") == "meshing"
        assert "overrun 0.5 µm, drift 0.01 N" in page.inner_text("#journal")
        store.paths.report.mkdir()
        (store.paths.report / "report.html").write_text("<p>the report</p>")
        viewing.tell_page("reported", "Not passed.", passed=False)
        page.wait_for_function(HEADED, arg="report: not passed")
    finally:
        viewing.release()
    with page.expect_popup() as opened:
        page.click("#alert a")
    assert opened.value.inner_text("p") == "the report"
