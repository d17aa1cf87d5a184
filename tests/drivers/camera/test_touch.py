"""Whether a touch is seen."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from drivers.camera.touch import Look, TouchWatch


def jpeg(seed, *, size=(640, 480), spot=0.0, light=0.0):
    """Return a noisy grey picture, darker by ``spot`` levels in its middle, lighter as a whole."""
    image = np.random.default_rng(seed).normal(120.0 + light, 3.0, (size[1], size[0]))
    cv2.circle(image, (size[0] // 2, size[1] // 2), size[1] // 10, 120.0 + light - spot, cv2.FILLED)
    return cv2.imencode(".jpg", np.clip(image, 0, 255).astype(np.uint8))[1].tobytes()


@pytest.fixture(params=[(640, 480), (64, 48)], ids=["640", "64"])
def watch(request):
    """Return a watch that knows what no contact looks like, and the size of its pictures."""
    looking = TouchWatch()
    looking.ask(Look.REFERENCE)
    for seed in range(10):
        assert not looking.see(jpeg(seed, size=request.param))
    looking.ask(Look.TOUCH)
    return looking, request.param


def test_a_dent_is_seen_and_noise_is_not(watch):
    """Thirty pictures without contact, then one with a spot."""
    looking, size = watch
    assert not any(looking.see(jpeg(seed, size=size)) for seed in range(20, 50))
    assert looking.see(jpeg(60, size=size, spot=60.0))


def test_light_that_changes_as_a_whole_is_no_touch(watch):
    """A lamp that warms up."""
    looking, size = watch
    assert not looking.see(jpeg(70, size=size, light=8.0))


def test_nothing_is_seen_unasked(watch):
    """Decoding costs time: only while asked for."""
    looking, size = watch
    looking.ask(Look.NOTHING)
    assert not looking.see(jpeg(60, size=size, spot=60.0))


def test_damaged_bytes_and_another_size_show_nothing(watch):
    """No touch, and no error either."""
    looking, _ = watch
    assert not looking.see(b"no picture")
    assert not looking.see(jpeg(1, size=(320, 240), spot=60.0))
