"""A twin beside a run, live and recorded: its phases, frames, and page."""

import json
import re
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from protocols.processes.ipc import Shown
from sim.sensor.camera_geometry import CameraGeometry
from sim.twin import press_follower
from tacauchy_rig.app.replay.open_run import open_run
from tacauchy_rig.app.twin.run_follower import (
    FRAMES_PER_S,
    MAPS_EVERY,
    STALE_NS,
    CameraImages,
    Follows,
    RunFollower,
    Twin,
    _lasting,
    contact_residual,
    twin_of,
    watch_run,
)
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import JournalEvent, Phase
from tests.recorded_run import new_run, pressed_run


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return the page of a run over mocks, whose frames are smaller than any sensor's.

    Its twin would be pressed by any noise of the cell that it were given.
    """
    store = pressed_run(tmp_path_factory.mktemp("runs"))

    def enlarged(images: CameraImages, jpeg: bytes) -> ImageArray:
        found = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
        size = images._geometry.width_px, images._geometry.height_px
        return np.asarray(cv2.resize(found, size), dtype=np.uint8)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(CameraImages, "of", enlarged)
        patched.setattr(press_follower, "NO_FORCE_N", 0.0)
        return watch_run(open_run(store.paths.root)).read_text("utf-8")


def _data(page: str) -> dict[str, Any]:
    found = re.search(r'id="data">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    data: dict[str, Any] = json.loads(found[1])
    return data


def test_every_frame_has_its_twin_at_the_measured_force(page: str) -> None:
    """From before the contact to after it, each force met, pictures of both and maps."""
    data = _data(page)
    assert [each["trial"] for each in data["trials"]] == [1, 2]
    for trial in data["trials"]:
        frames = trial["frames"]
        assert frames[0]["force_n"] == frames[-1]["force_n"] == 0.0
        times = np.array([frame["time_s"] for frame in frames])
        assert np.diff(times).min() > 0.9 / FRAMES_PER_S
        pressed = [frame for frame in frames if frame["force_n"] > 0.0]
        assert max(frame["force_n"] for frame in pressed) > 1.0
        for frame in pressed:
            assert frame["note"] == ""
            assert frame["force_n"] == pytest.approx(frame["measured_n"], rel=1e-3)
            for name in ("real", "twin", "pressure", "shear"):
                assert frame[name].startswith("data:image/jpeg;base64,")


def test_the_page_needs_no_other_file(page: str) -> None:
    """No address of anything but the pictures in it."""
    assert "http" not in page
    assert "{{" not in page
    assert not re.search(r"""(src|href)=["'](?!data:)""", page)


def test_a_run_without_a_contact_is_refused(tmp_path: Path) -> None:
    """Nothing was pressed yet."""
    store = new_run(tmp_path)
    with pytest.raises(RecordError, match="no trial has images of a contact"):
        watch_run(open_run(store.paths.root))


def test_the_longest_touch_counts() -> None:
    """Noise touches for a sample or two, before the press and after it."""
    touching = np.array([0, 1, 0, 0, 1, 1, 1, 0, 1, 1], dtype=bool)
    np.testing.assert_array_equal(np.flatnonzero(_lasting(touching)), [4, 5, 6])
    assert not _lasting(np.zeros(4, dtype=bool)).any()


VIEW = CameraGeometry.centred(80, 60, scale_x_m=1e-4, scale_y_m=1e-4)


def _jpeg(width: int, height: int) -> bytes:
    image = np.full((height, width, 3), 90, np.uint8)
    image[:, width // 2 :, 0] = 200  # blue, as OpenCV has it
    return bytes(cv2.imencode(".jpg", image)[1])


@pytest.mark.parametrize("frame_width", [160, 640, 3280])
def test_a_frame_becomes_an_image_of_the_views_size(frame_width: int) -> None:
    """Whatever the decoder leaves out: RGB, its right half blue."""
    images = CameraImages(VIEW, crop_fraction=0.15, frame_width_px=frame_width)
    image = images.of(_jpeg(frame_width, frame_width * 3 // 4))
    assert image is not None
    assert image.shape == (60, 80, 3)
    assert image[:, 50:, 2].mean() == pytest.approx(200, abs=8)
    assert image[:, :30, 2].mean() == pytest.approx(90, abs=8)


@pytest.mark.parametrize("jpeg", [b"", b"no picture", _jpeg(40, 30)])
def test_what_is_no_whole_image_is_none(jpeg: bytes) -> None:
    """Damaged bytes, none, and a frame that is smaller than the view."""
    assert CameraImages(VIEW, crop_fraction=0.0, frame_width_px=640).of(jpeg) is None


def test_the_residual_is_nothing_for_the_image_itself_and_one_without_contact() -> None:
    """And none is known where the real image shows no contact."""
    unloaded = np.full((60, 80, 3), 100, np.uint8)
    real = unloaded.copy()
    cv2.circle(real, (40, 30), 12, (160, 60, 130), -1)
    assert contact_residual(real, real, unloaded) == 0.0
    assert contact_residual(real, unloaded, unloaded) == pytest.approx(1.0)
    assert contact_residual(unloaded, real, unloaded) is None


@pytest.fixture(scope="module")
def simulator() -> Twin:
    """Return the twin of the default configuration."""
    return twin_of(load_config(None).config)


@pytest.fixture
def twin(simulator: Twin) -> RunFollower:
    """Return a twin whose run has just shown its no-contact frames."""
    made = RunFollower(simulator, Follows.FORCE)
    made.note(_phase(Phase.REFERENCE))
    frame = np.full((480, 640, 3), 120, np.uint8)
    picture = bytes(cv2.imencode(".jpg", frame)[1])
    made.take(Shown(stream="camera", stamp_ns=1, numbers={}, picture=picture))
    return made


def _phase(phase: Phase) -> JournalEvent:
    return JournalEvent(stamp_ns=1, name="phase", detail={"phase": phase.value}, trial=2)


def _force(*forces_n: float, age_ns: int = 0) -> Shown:
    numbers = {"force_n": list(forces_n)}
    return Shown(stream="force", stamp_ns=time.monotonic_ns() - age_ns, numbers=numbers)


def _arm(height_m: float) -> Shown:
    return Shown(stream="arm", stamp_ns=2, numbers={"position_m": (0.0, 0.0, height_m)})


def test_a_press_is_followed_over_the_runs_own_frame(twin: RunFollower) -> None:
    """The force is met, maps come with some frames, and no contact is the frame without one."""
    twin.note(_phase(Phase.APPROACH))
    twin.take(_force(0.0))
    made = twin.step()
    assert made is not None
    line, shown = made
    assert [each.stream for each in shown] == ["twin", "twin pressure", "twin shear"]
    image = cv2.imdecode(np.frombuffer(shown[0].picture or b"", np.uint8), cv2.IMREAD_COLOR)
    assert np.abs(image.astype(int) - 120).max() <= 3
    assert (line["force_n"], line["trial"], line["residual"]) == (0.0, 2, None)
    twin.note(_phase(Phase.PRESS))
    for number in range(MAPS_EVERY):
        twin.take(_force(1.0))
        made = twin.step()
        assert made is not None
        assert len(made[1]) == (3 if number == MAPS_EVERY - 1 else 1)
    line = made[0]
    assert line["asked_n"] == 1.0
    assert line["force_n"] == pytest.approx(1.0, rel=1e-4)
    assert line["force_error_n"] is not None
    assert 0.0 < line["force_error_n"] < 0.3
    assert line["lag_ms"] > 0.0


def test_between_presses_nothing_is_followed(twin: RunFollower) -> None:
    """While the arm goes home, the cell drifts and nothing is touched."""
    twin.note(_phase(Phase.DRIFT_CHECK))
    twin.take(_force(1.0))
    assert twin.step() is None


def test_what_is_old_is_left_out_and_counted(twin: RunFollower) -> None:
    """A force that waited in a full feed is of another moment."""
    twin.note(_phase(Phase.PRESS))
    before = twin.dropped_count
    twin.take(_force(1.0, age_ns=2 * STALE_NS))
    assert twin.step() is None
    assert twin.dropped_count == before + 1


def test_the_latest_force_wins_and_the_others_are_counted(twin: RunFollower) -> None:
    """Of three that came, the last sample of the last is followed, once."""
    for number in (1, 2, 3):
        twin.take(_force(0.0, 0.1 * number))
    goal = twin.goal()
    assert goal is not None
    assert (goal.force_n, goal.depth_m) == (pytest.approx(0.3), None)
    assert twin.dropped_count == 2
    assert twin.goal() is None


def test_depth_counts_from_where_the_press_begins(simulator: Twin) -> None:
    """Before and after, the force is followed; then the way down is added to what is pressed in."""
    twin = RunFollower(simulator, Follows.DEPTH)
    twin._depth_m = 20e-6
    goals = []
    for phase, force_n, height_m in (
        (Phase.APPROACH, 0.2, 0.1),
        (Phase.PRESS, 0.4, 0.0997),
        (Phase.DRIFT_CHECK, 0.5, 0.1),
    ):
        twin.note(_phase(phase))
        twin.take(_force(force_n))
        twin.take(_arm(height_m))
        goal = twin.goal()
        assert goal is not None
        goals.append((goal.force_n, goal.depth_m))
    assert goals == [(0.2, None), (None, pytest.approx(320e-6)), (0.5, None)]


def test_the_picture_nearest_in_time_is_found(simulator: Twin) -> None:
    """Of the last few; without any there is none."""
    twin = RunFollower(simulator, Follows.FORCE)
    assert twin.picture(1.0) is None
    for number in range(20):
        stamp = number * 40_000_000
        twin.take(Shown(stream="camera", stamp_ns=stamp, numbers={}, picture=b"%d" % number))
    assert twin.picture(0.681) == b"17"
    assert twin.picture(0.0) == b"12"
