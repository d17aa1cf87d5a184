"""Frames, curves and timing from raw streams."""

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from reports.comparison.report_criteria import MAX_SETTLED_CHANGE
from reports.evidence.evidence_types import ImageGeometry
from reports.evidence.frames_and_curves import (
    AttemptReading,
    crop_and_resize,
    decode_frame,
    settled_change,
    summarize_stream,
)
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import ForceSample, ImageFrame
from tacauchy_rig.core.store.recording.mcap_writer import RecordingWriter
from tacauchy_rig.core.store.run_store import RunStore

GEOMETRY = ImageGeometry()


def frame(image: np.ndarray, stamp_ns: int = 0) -> ImageFrame:
    """Return an RGB image as the camera would send it."""
    done, data = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 98])
    assert done
    return ImageFrame(
        stamp_ns=stamp_ns,
        counter=0,
        device_stamp_s=None,
        width=image.shape[1],
        height=image.shape[0],
        jpeg=data.tobytes(),
    )


def flat(color: tuple[int, int, int], shape: tuple[int, int] = (480, 640)) -> np.ndarray:
    """Return an image of one colour."""
    return np.broadcast_to(np.array(color, np.uint8), (*shape, 3)).copy()


def read(
    store: RunStore,
    press: SimpleNamespace,
    frames: Sequence[ImageFrame],
    *,
    force_n: Sequence[float] = (),
    z_m: Sequence[float] = (),
) -> AttemptReading:
    """Record frames, raw forces and heights (10 ms apart from the dwell on) and read them."""
    path = store.paths.recording(1, 1)
    path.unlink()
    with RecordingWriter(path, metadata={}) as writer:
        for k, value in enumerate(force_n):
            wrench = (0.0, 0.0, value, 0.0, 0.0, 0.0)
            stamp = press.at(2.0 + 0.01 * k)
            writer.write([ForceSample(stamp_ns=stamp, counter=k, wrench=wrench)])
        for k, value in enumerate(z_m):
            writer.write([press.arm_at(press.at(2.0 + 0.01 * k), value)])
        for one in frames:
            writer.write([one])
    return AttemptReading(store, press.record(1), GEOMETRY)


def test_colours_come_out_as_rgb() -> None:
    """Red stays red through JPEG and OpenCV's channel order."""
    decoded = decode_frame(frame(flat((200, 30, 10))))
    assert np.allclose(decoded[5, 5], (200, 30, 10), atol=3)


def test_crop_takes_the_border_of_each_side() -> None:
    """A painted border of 15 % is gone, and not a pixel more of the middle."""
    image = flat((255, 255, 255))
    image[72:408, 96:544] = 0
    image[71, :] = image[408, :] = 255
    cropped = crop_and_resize(image, GEOMETRY)
    assert cropped.shape == (240, 320, 3)
    assert cropped.max() == 0
    wider = crop_and_resize(image, ImageGeometry(crop_fraction=0.14))
    assert wider[0].min() > 0


def test_resize_averages_areas() -> None:
    """The scored image keeps the mean of fine stripes instead of aliasing."""
    image = flat((0, 0, 0), (960, 1280))
    image[:, ::2] = 200
    assert np.allclose(crop_and_resize(image, GEOMETRY), 100, atol=36)
    assert crop_and_resize(image, GEOMETRY).mean() == pytest.approx(100, abs=1.0)


def test_small_frames_are_refused() -> None:
    """A frame that would have to be enlarged is refused with a remedy."""
    with pytest.raises(RecordError, match="400x300 px") as caught:
        crop_and_resize(flat((0, 0, 0), (300, 400)), GEOMETRY)
    assert "camera mode" in caught.value.remedy


def test_dwell_is_split_and_broken_frames_are_left_out(
    store: RunStore, press: SimpleNamespace
) -> None:
    """Halves come from the two ends of the dwell; bytes that are no image are left out."""
    dwell = [frame(flat((90 + k, 90, 90)), press.at(2.0 + 0.1 * k)) for k in range(6)]
    broken = replace(dwell[0], stamp_ns=press.at(2.9), jpeg=b"\xff\xd8junk")
    images = read(store, press, [frame(flat((50, 50, 50)), press.at(0.5)), *dwell, broken]).images
    assert images.frame_count == 6
    difference = images.second_half.astype(int) - images.first_half.astype(int)
    assert difference[..., 0].mean() == pytest.approx(3.0, abs=1.0)
    assert images.reference.mean() == pytest.approx(50, abs=2)


@pytest.mark.parametrize("unloaded", [0, 1])
def test_too_few_frames(store: RunStore, press: SimpleNamespace, unloaded: int) -> None:
    """Three frames make an image but no halves; none in either window makes nothing."""
    dark = flat((50, 50, 50))
    reference = [frame(dark, press.at(0.5))] * unloaded
    images = read(store, press, [*reference, *[frame(dark, press.at(2.5))] * 3]).images
    assert (images is None) is (unloaded == 0)
    assert images is None or images.first_half is None
    assert read(store, press, reference).images is None


def test_force_is_tared_and_positive_in_compression(
    store: RunStore, press: SimpleNamespace
) -> None:
    """A sensor that reads -3.2 N when pressed and 0.8 N unloaded felt 4 N."""
    sensor = store.config.force_sensor.model_copy(update={"compression_sign": -1})
    store.config = store.config.model_copy(update={"force_sensor": sensor})
    curve = read(store, press, [], force_n=(0.8, -3.2)).force_curve
    assert curve.value == pytest.approx([0.0, 4.0])
    assert curve.time_s == pytest.approx([0.0, 0.01])


def test_the_wrench_of_a_dwell_is_tared_and_has_an_error(
    store: RunStore, press: SimpleNamespace
) -> None:
    """Its mean in the cell's own frame; a dwell of few samples has none."""
    attempt = read(store, press, [], force_n=(3.0, 3.2) * 8)
    found, tare = attempt.dwell_wrench, attempt.record.tare_before
    assert found is not None
    mean, error = found
    assert mean[2] == pytest.approx(3.1 - tare.mean[2])
    scatter = 0.1 * np.sqrt(16 / 15)
    least = scatter / np.sqrt(16)
    assert error[2] == pytest.approx(np.hypot(least, tare.deviation[2] / tare.sample_count**0.5))
    assert read(store, press, [], force_n=(3.0, 3.2)).dwell_wrench is None


def test_a_press_lasts_from_the_touch_to_the_middle_of_its_dwell(
    store: RunStore, press: SimpleNamespace
) -> None:
    """Heights are recorded from the dwell on alone: nobody knows when it was touched."""
    attempt = read(store, press, [], z_m=(0.1995, 0.1992))
    assert attempt.press_duration_s is None


def test_depth_grows_downwards(store: RunStore, press: SimpleNamespace) -> None:
    """Half a millimetre below first contact is a depth of 0.5 mm."""
    curve = read(store, press, [], z_m=(0.2002, 0.1992)).depth_curve
    assert curve.value == pytest.approx([-0.5e-3, 0.5e-3])


def test_losses_are_counted_from_the_native_counter() -> None:
    """Counters 5, 6, 9 lack two samples; a stream without a counter says nothing."""
    stamps = np.array([0, 10_000_000, 40_000_000])
    timing = summarize_stream("force", stamps, np.array([5, 6, 9]))
    assert timing.lost_count == 2
    assert timing.interval_max_ms == pytest.approx(30.0)
    assert summarize_stream("arm", stamps).lost_count is None
    assert summarize_stream("arm", stamps[:1]) is None


def test_frames_of_the_dwell_are_chosen_at_corrected_times(
    store: RunStore, press: SimpleNamespace
) -> None:
    """A camera 0.5 s late shows the dwell 0.5 s later; force stamps that are late shift it back."""
    frames = [frame(flat((0, 0, 0)), press.at(0.5))] + [
        frame(flat((level, level, level)), press.at(2.05 + 0.1 * k))
        for k, level in enumerate((50, 50, 50, 50, 50, *[150] * 10))
    ]
    seen = []
    for camera_s, force_s in ((0.0, 0.0), (0.5, 0.0), (0.5, 0.5)):
        config = store.config
        late = {
            "camera": config.camera.model_copy(update={"delay": camera_s}),
            "force_sensor": config.force_sensor.model_copy(update={"delay": force_s}),
        }
        shifted = RunStore.open(store.paths.root)
        shifted.config = config.model_copy(update=late)
        images = read(shifted, press, frames).images
        seen.append(int(images.first_half.mean().round(-1)))
    assert seen == [50, 150, 50]


def test_curves_of_force_and_depth_lie_at_corrected_times(
    store: RunStore, press: SimpleNamespace
) -> None:
    """Time zero is when the dwell began: force stays where it is, the arm's depth comes later."""
    config = store.config.force_sensor.model_copy(update={"delay": 0.04})
    before = read(store, press, [], force_n=[1.0] * 20, z_m=[0.2] * 20)
    depth_s, force_s = before.depth_curve.time_s[0], before.force_curve.time_s[0]
    store.config = store.config.model_copy(update={"force_sensor": config})
    after = read(store, press, [], force_n=[1.0] * 20, z_m=[0.2] * 20)
    assert abs(after.force_curve.time_s[0] - force_s) < 1e-9
    assert abs(after.depth_curve.time_s[0] - depth_s - 0.04) < 1e-9
    assert (after.force.stamp_ns == before.force.stamp_ns).all()


SHAPE = (60, 80, 3)
FRAMES = 30  # 1.2 s at 25 fps
CONTACT = np.zeros(SHAPE)
CONTACT[20:40, 30:50] = 25.0
RNG_SEED = 5


def dwell(shares: Sequence[float], *, noise: float = 1.5) -> list[ImageArray]:
    """Return frames that show each a share of the contact, with noise of so many grey levels."""
    rng = np.random.default_rng(RNG_SEED)
    return [
        np.clip(np.rint(110.0 + share * CONTACT + rng.normal(0.0, noise, SHAPE)), 0, 255).astype(
            np.uint8
        )
        for share in shares
    ]


REFERENCE = np.full(SHAPE, 110, dtype=np.uint8)


@pytest.mark.parametrize("noise", [0.0, 1.5, 4.0])
def test_noise_alone_is_no_change(noise: float) -> None:
    """A still contact, however noisy the camera."""
    assert settled_change(dwell([1.0] * FRAMES, noise=noise), REFERENCE) < 0.02


def test_a_camera_that_repeats_its_noise_is_not_accused() -> None:
    """As the emulated one does on a busy computer: three pictures for thirty frames."""
    one, two, three = dwell([1.0] * 3)
    assert settled_change([one] * 11 + [two] * 9 + [three] * 10, REFERENCE) < 0.02


def test_a_creeping_gel_is_not_accused() -> None:
    """Three percent more contact at the end than at the beginning, step by step."""
    found = settled_change(dwell(np.linspace(0.97, 1.0, FRAMES).tolist()), REFERENCE)
    assert 0.015 < found < MAX_SETTLED_CHANGE


@pytest.mark.parametrize("late", [6, 12, 23, 27])
def test_an_older_pose_is_found(late: int) -> None:
    """So many frames of a pose with three quarters of the contact: 23 frames are 0.93 s."""
    found = settled_change(dwell([0.75] * late + [1.0] * (FRAMES - late)), REFERENCE)
    expected = 0.25 * min(late, FRAMES - late, 10) / 10.0 / (1.0 - 0.25 * late / FRAMES)
    assert found == pytest.approx(expected, rel=0.1)
    assert found > MAX_SETTLED_CHANGE


def test_too_few_frames_tell_nothing() -> None:
    """Two frames have no thirds."""
    assert settled_change(dwell([1.0, 0.5]), REFERENCE) is None
    assert settled_change(dwell([1.0, 1.0, 0.5], noise=0.0), REFERENCE) > 0.4
