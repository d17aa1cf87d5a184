"""Scores have the values that their definitions give by hand."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from skimage.metrics import structural_similarity

from reports.scores.confidence_interval import t_interval
from reports.scores.image_metrics import (
    histogram_correlation,
    psnr_of,
    psnr_of_mean_mse,
    score,
    structural_similarity_index,
    zero_mean_correlation,
)
from tacauchy_rig.core.errors import RecordError

RNG = np.random.default_rng(0)
IMAGE = RNG.integers(20, 200, (60, 80, 3), dtype=np.uint8)
OTHER = np.clip(IMAGE + RNG.normal(0, 12, IMAGE.shape), 0, 255).astype(np.uint8)


def test_ssim_is_the_one_of_wang_2004() -> None:
    """Colour SSIM is the mean over channels of the Gaussian-window form with sigma 1.5."""
    channels = [
        structural_similarity(
            IMAGE[..., c],
            OTHER[..., c],
            gaussian_weights=True,
            sigma=1.5,
            use_sample_covariance=False,
            data_range=255,
        )
        for c in range(3)
    ]
    assert structural_similarity_index(IMAGE, OTHER) == pytest.approx(np.mean(channels), abs=1e-12)


def test_ssim_of_flat_images_is_the_luminance_term() -> None:
    """Without structure only (2ab + C1) / (a^2 + b^2 + C1) is left, C1 = (0.01 255)^2."""
    a, b, c1 = 100.0, 150.0, 2.55**2
    first, second = np.full((40, 40), 100, np.uint8), np.full((40, 40), 150, np.uint8)
    expected = (2 * a * b + c1) / (a * a + b * b + c1)
    assert structural_similarity_index(first, second) == pytest.approx(expected, abs=1e-9)


def test_histogram_does_not_see_places() -> None:
    """Shuffled pixels keep a histogram correlation of 1 while SSIM and NCC collapse."""
    shuffled = RNG.permutation(IMAGE.reshape(-1, 3)).reshape(IMAGE.shape)
    scores = score(IMAGE, shuffled)
    assert scores.histogram_correlation == pytest.approx(1.0, abs=1e-12)
    assert scores.ssim < 0.2
    assert abs(scores.ncc) < 0.2


def test_histograms_without_overlap_do_not_correlate() -> None:
    """Two single grey levels correlate by -1/255 in 256 bins."""
    first, second = np.full((8, 8), 10, np.uint8), np.full((8, 8), 200, np.uint8)
    assert histogram_correlation(first, second) == pytest.approx(-1 / 255, abs=1e-9)


def test_gain_error_alone_lowers_psnr() -> None:
    """15 % gain on a flat grey of 120 leaves an error of 18 levels: 23.03 dB."""
    flat = np.full((30, 30, 3), 120, np.uint8)
    brighter = np.full((30, 30, 3), 138, np.uint8)
    scores = score(flat, brighter)
    assert scores.mse == 18.0**2
    assert scores.psnr_db == pytest.approx(20 * math.log10(255 / 18), abs=1e-9)


@given(st.floats(0.2, 5.0), st.floats(-50.0, 50.0))
def test_ncc_ignores_gain_and_offset(gain: float, offset: float) -> None:
    """The zero-mean correlation with gain * image + offset is 1."""
    values = IMAGE.astype(np.float64)
    assert zero_mean_correlation(values, gain * values + offset) == pytest.approx(1.0, abs=1e-9)


def test_ncc_of_a_negative_and_of_a_flat_image() -> None:
    """An inverted image correlates by -1; with a flat one no correlation exists."""
    assert score(IMAGE, 255 - IMAGE).ncc == pytest.approx(-1.0, abs=1e-12)
    assert math.isnan(score(IMAGE, np.full_like(IMAGE, 90)).ncc)


def test_identical_images() -> None:
    """Identity is perfect in every score, and its PSNR infinite."""
    scores = score(IMAGE, IMAGE)
    assert (scores.ssim, scores.ncc, scores.mse) == (1.0, pytest.approx(1.0), 0.0)
    assert scores.psnr_db == math.inf


def test_squares_do_not_wrap() -> None:
    """The squared error of 0 against 255 is 65025, not what 8 bits leave of it."""
    black, white = np.zeros((16, 16), np.uint8), np.full((16, 16), 255, np.uint8)
    assert score(black, white).mse == 65025.0
    assert score(black, white).psnr_db == 0.0


@pytest.mark.parametrize(
    ("first", "second", "named"),
    [
        (IMAGE, IMAGE[:-1], "(59, 80, 3)"),
        (IMAGE, IMAGE[..., 0], "(60, 80)"),
        (IMAGE.astype(np.float64), IMAGE, "float64"),
        (IMAGE[..., :2], IMAGE[..., :2], "(60, 80, 2)"),
    ],
)
def test_wrong_images_are_refused(first: np.ndarray, second: np.ndarray, named: str) -> None:
    """Other shapes and types are refused by name."""
    with pytest.raises(RecordError, match=r"cannot be") as caught:
        score(first, second)
    assert named in str(caught.value)


def test_interval_of_six_values() -> None:
    """1..6: mean 3.5, deviation 1.8708, t(5) = 2.5706, so 3.5 +- 1.9633."""
    interval = t_interval([1, 2, 3, 4, 5, 6])
    assert interval.mean == 3.5
    assert interval.high == pytest.approx(3.5 + 1.9633, abs=1e-4)
    assert interval.low == pytest.approx(3.5 - 1.9633, abs=1e-4)


def test_interval_leaves_out_what_does_not_exist() -> None:
    """NaN and infinity do not count; one value has no interval, none has no mean."""
    assert t_interval([1.0, math.nan, 3.0, math.inf]).count == 2
    assert t_interval([2.0]).low is None
    assert t_interval([math.nan]).mean is None


@given(st.lists(st.floats(0.01, 1e4), min_size=1, max_size=8))
def test_psnr_of_mean_mse_never_exceeds_mean_of_psnrs(errors: list[float]) -> None:
    """Jensen: the two averages differ, and always in this direction."""
    assert psnr_of_mean_mse(errors) <= np.mean([psnr_of(e) for e in errors]) + 1e-9
