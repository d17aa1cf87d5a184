"""What is told about a JPEG cheaply: whether it is whole, its size, and too much light."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.camera.frame_checks import TouchWatch, clipped_ratio, jpeg_size
from drivers.interfaces import TouchMode


def encoded(width: int, height: int, *flags: int) -> bytes:
    """Return a noisy JPEG."""
    image = np.random.default_rng(3).integers(0, 255, (height, width, 3), dtype=np.uint8)
    return bytes(cv2.imencode(".jpg", image, list(flags))[1].tobytes())


@pytest.mark.parametrize(
    "flags",
    [
        (),
        (cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
        (cv2.IMWRITE_JPEG_OPTIMIZE, 1),
        (cv2.IMWRITE_JPEG_RST_INTERVAL, 4),
    ],
)
def test_size_of_every_kind(flags: tuple[int, ...]) -> None:
    """Baseline, progressive, optimised and restart-marked images give their size."""
    assert jpeg_size(encoded(321, 199, *flags)) == (321, 199)


def test_padding_is_allowed_and_what_is_cut_is_refused() -> None:
    """Zero bytes that a camera appends do not matter; images without start or end are none."""
    data = encoded(64, 48)
    assert jpeg_size(data + bytes(100)) == (64, 48)
    for cut in (data[:-3], data[1:], b"\xff\xd8\xff\xd9", b""):
        assert jpeg_size(cut) is None


@settings(deadline=None)
@given(st.binary(max_size=200))
def test_any_bytes_are_answered(data: bytes) -> None:
    """No input raises or loops, and a size is read only between the right ends, at 16 bits each."""
    assert jpeg_size(data) is None or data.startswith(b"\xff\xd8")
    found = jpeg_size(b"\xff\xd8" + data + b"\xff\xd9")
    assert found is None or all(0 <= length < 2**16 for length in found)


@settings(deadline=None)
@given(st.binary(max_size=50), st.tuples(*[st.integers(0, 2**16 - 1)] * 2))
def test_what_lies_before_the_frame_header_is_skipped(data: bytes, size: tuple[int, int]) -> None:
    """Whatever a segment holds, ends and headers among it, the size is that of the frame."""
    width, height = size
    segment = b"\xff\xe0" + (len(data) + 2).to_bytes(2, "big") + data
    frame = b"\xff\xc0\x00\x0b\x08" + height.to_bytes(2, "big") + width.to_bytes(2, "big")
    assert jpeg_size(b"\xff\xd8" + segment + frame + b"\x01\x01\x11\x00\xff\xd9") == size


def lit_from_above(white_rows: int) -> bytes:
    """Return a grey image of 240 x 320 pixels whose first rows are white."""
    image = np.full((240, 320, 3), 150, np.uint8)
    image[:white_rows] = 255
    return cv2.imencode(".jpg", image)[1].tobytes()


@pytest.mark.parametrize(("white_rows", "ratio"), [(0, 0.0), (60, 0.25), (240, 1.0)])
def test_the_share_of_white_pixels_is_found(white_rows: int, ratio: float) -> None:
    """An eighth of the size is enough to see it; a damaged frame says nothing."""
    assert clipped_ratio(lit_from_above(white_rows)) == pytest.approx(ratio, abs=0.02)
    assert clipped_ratio(b"\xff\xd8 no image \xff\xd9") is None


def jpeg(seed, *, size=(640, 480), spot=0.0, light=0.0):
    """Return a noisy grey picture, darker by ``spot`` levels in its middle, lighter as a whole."""
    image = np.random.default_rng(seed).normal(120.0 + light, 3.0, (size[1], size[0]))
    cv2.circle(image, (size[0] // 2, size[1] // 2), size[1] // 10, 120.0 + light - spot, cv2.FILLED)
    return cv2.imencode(".jpg", np.clip(image, 0, 255).astype(np.uint8))[1].tobytes()


@pytest.fixture(params=[(640, 480), (64, 48)], ids=["640", "64"])
def watch(request):
    """Return a watch that knows what no contact looks like, and the size of its pictures."""
    looking = TouchWatch()
    looking.ask(TouchMode.REFERENCE)
    for seed in range(10):
        assert not looking.see(jpeg(seed, size=request.param))
    looking.ask(TouchMode.TOUCH)
    return looking, request.param


def test_a_dent_is_seen_and_nothing_else(watch):
    """No noise, no lamp that warms up, no damaged bytes, no other size; and nothing unasked."""
    looking, size = watch
    assert not any(looking.see(jpeg(seed, size=size)) for seed in range(20, 50))
    dented = jpeg(60, size=size, spot=60.0)
    others = jpeg(70, size=size, light=8.0), b"no picture", jpeg(1, size=(320, 240), spot=60.0)
    assert not any(map(looking.see, others))
    assert looking.see(dented)
    looking.ask(TouchMode.NOTHING)
    assert not looking.see(dented)
