"""A made-up run: a flat punch whose image, force and depth are known in closed form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray

from reports.comparison.compare import compare
from reports.comparison.results import ValidationReport
from reports.evidence.evidence import (
    Curve,
    ImageGeometry,
    JournalSummary,
    RunEvidence,
    StreamTiming,
    Thresholds,
    TrialEvidence,
    TrialImages,
    TruthComparison,
)
from reports.page.writing import ReportPaths, write_report
from tacauchy_rig.run import Outcome, ReplayTrial, TrialRecord
from tests.made_model import made_model

HEIGHT, WIDTH = 240, 320
PUNCH_RADIUS_PX = 39.4
STIFFNESS_N_M = 7000.0
FORCES_N = (1.2556, 1.9511, 2.6466, 3.3422, 4.0377, 4.7332)
TRUE_POSE_PX = (2.3, -1.6)
TRUE_GAIN = 1.03

Image = NDArray[np.uint8]


def background() -> NDArray[np.float64]:
    """Return the unloaded gel under three coloured lights, shape [height, width, 3]."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    u, v = x / WIDTH - 0.5, y / HEIGHT - 0.5
    falloff = 1.0 - 0.5 * (u**2 + v**2)
    channels = [118 + 46 * u, 124 - 38 * v, 132 - 40 * u + 22 * v]
    return np.stack(channels, axis=2) * falloff[..., None]


def contact_change(
    force_n: float, *, center_px: tuple[float, float] = (160.0, 120.0), skirt_px: float = 9.0
) -> NDArray[np.float64]:
    """Return how a punch of ``force_n`` [N] changes the image, shape [height, width, 3]."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    dx, dy = x - center_px[0], y - center_px[1]
    radius = np.hypot(dx, dy) + 1e-9
    outside = np.maximum(radius - PUNCH_RADIUS_PX, 0.0)
    rim = 1.0 / (1.0 + np.exp(-(radius - PUNCH_RADIUS_PX) / 1.2))
    slope = 58.0 * force_n / 4.7332 * rim * np.exp(-outside / skirt_px)
    shade = -9.0 * force_n / 4.7332 * (1.0 - rim)
    cos, sin = dx / radius, dy / radius
    third = -0.5 * cos - 0.8660254 * sin
    return np.stack([slope * cos + shade, slope * sin + shade, slope * third + shade], axis=2)


def to_image(values: NDArray[np.float64]) -> Image:
    """Round and clip to 8 bits."""
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


def trial_images(force_n: float, rng: np.random.Generator) -> TrialImages:
    """Return noisy real images of a press with the pose and light errors named above."""
    center = (160.0 + TRUE_POSE_PX[0], 120.0 + TRUE_POSE_PX[1])
    pressed = TRUE_GAIN * (background() + contact_change(force_n, center_px=center, skirt_px=10.0))

    def shoot(values: NDArray[np.float64], noise: float) -> Image:
        return to_image(values + rng.normal(0.0, noise, values.shape))

    return TrialImages(
        real=shoot(pressed, 0.6),
        reference=shoot(background(), 0.6),
        first_half=shoot(pressed, 0.9),
        second_half=shoot(pressed, 0.9),
        frame_count=30,
    )


def press_curves(force_n: float, rng: np.random.Generator) -> tuple[Curve, Curve]:
    """Return force [N] and depth [m] over a press, dwell and retraction."""
    force_time = np.arange(-8.0, 3.2, 0.01)
    depth = force_n / STIFFNESS_N_M
    start = -6.0
    ramp = np.clip((force_time - start) / (-0.6 - start), 0.0, 1.0)
    release = np.clip((force_time - 1.4) / 0.5, 0.0, 1.0)
    shape = ramp * (1.0 - release)
    relaxation = 1.0 + 0.02 * np.exp(-np.maximum(force_time + 0.6, 0.0) / 0.4) * (ramp >= 1.0)
    force = force_n * shape**1.15 * relaxation + rng.normal(0.0, 0.008, force_time.shape)
    depth_time = np.arange(-8.0, 3.2, 0.008)
    travel = np.interp(depth_time, force_time, shape) * depth * 0.97
    air = np.where(depth_time < start, 1e-3 * (start - depth_time) / 2.0, 0.0)
    air += 2e-3 * np.clip((depth_time - 1.9) / 0.5, 0.0, 1.0)
    return Curve(time_s=force_time, value=force), Curve(time_s=depth_time, value=travel - air)


def trial_evidence(index: int, force_n: float, rng: np.random.Generator) -> TrialEvidence:
    """Return one complete, passing trial."""
    force, depth = press_curves(force_n, rng)
    measured = force_n + float(rng.normal(0.0, 0.008))
    depth_simulated = measured / STIFFNESS_N_M
    depth_measured = depth_simulated * (0.97 + 0.01 * float(rng.normal()))
    images = trial_images(force_n, rng)
    history = tuple(
        (depth_simulated * k, measured * k**1.1 * 1.01) for k in (0.25, 0.5, 0.8, 0.95, 1.0)
    )
    depths = np.linspace(0.0, 0.8e-3, 17)
    return TrialEvidence(
        index=index,
        force_target_n=force_n,
        record=TrialRecord(
            index=index,
            attempt=1,
            outcome=Outcome.PASSED,
            force_target_n=force_n,
            force_measured_n=measured,
            force_deviation_n=0.009,
            force_rate_n_s=0.01,
            force_drift_n=0.012,
            contact_z_m=0.2,
            depth_measured_m=depth_measured,
            rates={"force_rate_hz": 100.1, "image_rate_hz": 25.0},
        ),
        replay=ReplayTrial(
            index=index,
            force_measured_n=measured,
            force_simulated_n=measured * 1.01,
            depth_simulated_m=depth_simulated,
            force_error_estimate=0.02,
            force_error_basis="Richardson estimate over three meshes",
            newton_iterations=31,
            search_iterations=5,
            wall_s={"solve": 3.2, "render": 0.1},
            balance_relative=3e-8,
            gap_min_m=4e-6,
            min_jacobian=0.71,
            force_history=history,
        ),
        images=images,
        simulated_image=to_image(images.reference + contact_change(measured)),
        force_curve=force,
        depth_curve=depth,
        dwell_s=(0.0, 1.2),
        force_depth_simulated=np.stack([depths, 1.01 * STIFFNESS_N_M * depths], axis=1),
        streams=(
            StreamTiming(
                name="force",
                nominal_rate_hz=100.0,
                intervals_s=np.abs(rng.normal(0.01, 0.0006, 1100)),
                lost_count=0,
            ),
            StreamTiming(
                name="image",
                nominal_rate_hz=25.0,
                intervals_s=np.abs(rng.normal(0.04, 0.002, 280)),
                lost_count=0,
            ),
            StreamTiming(
                name="arm",
                nominal_rate_hz=None,
                intervals_s=np.abs(rng.normal(0.008, 0.0004, 1400)),
                lost_count=None,
            ),
        ),
    )


def run_evidence(*, seed: int = 3, simulated: bool = True) -> RunEvidence:
    """Return six passing trials of a made-up run."""
    rng = np.random.default_rng(seed)
    trials = tuple(trial_evidence(i, f, rng) for i, f in enumerate(FORCES_N, start=1))
    truth = tuple(
        TruthComparison(name="pressing force", true=f, recovered=f * 1.003, unit="N", trial=i)
        for i, f in enumerate(FORCES_N, start=1)
    )
    return RunEvidence(
        trials=trials,
        simulated=simulated,
        thresholds=Thresholds(max_force_mismatch_n=0.08, ssim=0.5),
        geometry=ImageGeometry(scale_x_m_px=6.34e-5, scale_y_m_px=6.34e-5),
        provenance={
            "name": "synthetic",
            "created": "2026-01-02T03:04:05Z",
            "versions": {"tacauchy-rig": "0.1.0", "numpy": "2.4.6"},
            "config_hash": "0f" * 32,
            "seed": 7,
            "devices": {
                "robot": {
                    "driver": "emulated",
                    "model": "e-series",
                    "serial": "E-0001",
                    "simulated": simulated,
                }
            },
        },
        journal=JournalSummary(attempt_count=7, fault_count=1, faults=("camera: unplugged",)),
        model=made_model(),
        truth=(
            *truth,
            TruthComparison(name="light gain", true=1.03, recovered=1.027, unit=""),
            TruthComparison(name="pose error along x", true=0.146, recovered=0.139, unit="mm"),
        ),
    )


@pytest.fixture(scope="session")
def made() -> SimpleNamespace:
    """What the made-up images are made with, for tests that need other ones."""
    return SimpleNamespace(
        background=background,
        contact_change=contact_change,
        to_image=to_image,
        PUNCH_RADIUS_PX=PUNCH_RADIUS_PX,
        TRUE_POSE_PX=TRUE_POSE_PX,
        TRUE_GAIN=TRUE_GAIN,
        FORCES_N=FORCES_N,
    )


@pytest.fixture(scope="session")
def evidence() -> RunEvidence:
    """Six passing trials."""
    return run_evidence()


@pytest.fixture(scope="session")
def report(evidence: RunEvidence) -> ValidationReport:
    """The made-up run, compared."""
    return compare(evidence)


@pytest.fixture(scope="session")
def written(report: ValidationReport, tmp_path_factory: pytest.TempPathFactory) -> ReportPaths:
    """Its report on disk."""
    return write_report(report, tmp_path_factory.mktemp("report"))


@pytest.fixture(scope="session")
def incomplete(evidence: RunEvidence) -> ValidationReport:
    """A real run whose second trial missed its force, third failed and fourth never happened."""
    trials = list(evidence.trials)
    second, third, fourth = trials[1:4]
    trials[1] = replace(second, replay=replace(second.replay, force_simulated_n=2.2))
    trials[2] = replace(
        third,
        record=replace(third.record, outcome=Outcome.FAULT, reason="camera <went> away"),
        images=None,
        simulated_image=None,
        replay=None,
    )
    trials[3] = TrialEvidence(index=fourth.index, force_target_n=fourth.force_target_n)
    return compare(replace(evidence, trials=tuple(trials), simulated=False))


@pytest.fixture
def change_trial() -> Callable[..., RunEvidence]:
    """Return a function that replaces fields of one trial."""

    def change(run: RunEvidence, index: int, **fields: object) -> RunEvidence:
        trials = tuple(
            replace(t, **fields) if t.index == index else t  # type: ignore[arg-type]
            for t in run.trials
        )
        return replace(run, trials=trials)

    return change
