"""Made-up runs, in memory and on disk: a flat punch whose image, force and depth are known."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from reports.comparison.result_types import ValidationReport
from reports.comparison.run_comparison import compare
from reports.evidence.evidence_types import (
    Curve,
    ImageGeometry,
    JournalSummary,
    RunEvidence,
    StreamSummary,
    TrialEvidence,
    TrialImages,
)
from reports.page import summary_and_junit as report_files
from reports.page.summary_and_junit import ReportPaths, write_report
from tacauchy_rig.core.config.settings import ReportSection
from tacauchy_rig.core.run import (
    ArmSample,
    Criterion,
    ForceSample,
    ImageFrame,
    JournalEvent,
    Outcome,
    Pose,
    Tare,
    TrialRecord,
)
from tacauchy_rig.core.simulated import ForceDepthCurve, Replay, ReplayTrial
from tacauchy_rig.core.store.journal import append_event
from tacauchy_rig.core.store.recording.mcap_writer import RecordingWriter
from tacauchy_rig.core.store.run_store import ReplayFields, RunStore
from tests.made_model import made_model
from tests.recorded_run import empty_run

HEIGHT, WIDTH = 240, 320
PUNCH_RADIUS_PX = 39.4
STIFFNESS_N_M = 7000.0
FORCES_N = (1.2556, 1.9511, 2.6466, 3.3422, 4.0377, 4.7332)
TRUE_POSE_PX = (0.5, -0.35)
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
            tare_before=Tare(
                start_ns=0,
                end_ns=10**9,
                mean=(0.1, -0.2, 0.3, 0.0, 0.0, 0.0),
                deviation=(0.007,) * 6,
                sample_count=100,
            ),
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
        force_depth_simulated=ForceDepthCurve(
            depth_m=depths, force_n=1.01 * STIFFNESS_N_M * depths
        ),
        streams=tuple(
            StreamSummary(
                name=name,
                nominal_rate_hz=rate_hz,
                rate_hz=rate_hz or 125.0,
                sample_count=1000,
                lost_count=None if rate_hz is None else 0,
                interval_median_ms=10.0,
                interval_p99_ms=12.0,
                interval_max_ms=13.0,
            )
            for name, rate_hz in (("force", 100.0), ("image", 25.0), ("arm", None))
        ),
    )


def run_evidence(*, seed: int = 3, simulated: bool = True) -> RunEvidence:
    """Return six passing trials of a made-up run."""
    rng = np.random.default_rng(seed)
    trials = tuple(trial_evidence(i, f, rng) for i, f in enumerate(FORCES_N, start=1))
    return RunEvidence(
        trials=trials,
        simulated=simulated,
        thresholds=ReportSection.model_construct(
            min_force_margin=3.0,
            max_contact_residual=0.9,  # the made-up light is 3 % brighter in the dwell
            max_contact_offset=6e-5,
            coverage_factor=2.0,
            min_modulus_trials=4,
            max_force_mismatch=0.08,
        ),
        geometry=ImageGeometry(scale_x_m_px=6.34e-5, scale_y_m_px=6.34e-5),
        provenance={
            "name": "synthetic",
            "created": "2026-01-02T03:04:05Z",
            "versions": {"tacauchy-rig": "0.1.0", "numpy": "2.4.6"},
            "config_hash": "0f" * 32,
            "seed": 7,
            "recorded": None,
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


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Write reports without figures, which take a second each."""
    monkeypatch.setattr(report_files, "draw_figures", lambda *_: [])


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


START_NS = 7_000_000_000
CONTACT_Z_M, TARE_N, FORCE_N, DEPTH_M = 0.1997, 0.8, 1.2556, 2.0e-4
TARE = Tare(
    start_ns=START_NS,
    end_ns=START_NS + 10**9,
    mean=(0.0, 0.0, TARE_N, 0.0, 0.0, 0.0),
    deviation=(0.007,) * 6,
    sample_count=100,
)


def at(second: float) -> int:
    """Return a stamp [ns]."""
    return START_NS + round(second * 1e9)


def record(index: int, *, outcome: Outcome = Outcome.PASSED) -> TrialRecord:
    """Return a press with no-contact frames from 0 to 1 s and a dwell from 2 to 3 s."""
    return TrialRecord(
        index=index,
        attempt=1,
        outcome=outcome,
        force_target_n=FORCE_N,
        force_measured_n=FORCE_N,
        contact_z_m=CONTACT_Z_M,
        depth_measured_m=DEPTH_M,
        tare_before=TARE,
        reference_start_ns=at(0.0),
        reference_end_ns=at(1.0),
        dwell_start_ns=at(2.0),
        dwell_end_ns=at(3.0),
        criteria=(Criterion.at_most("force_mean", 0.0, 0.03, unit="N", remedy=""),),
    )


def arm_at(stamp_ns: int, z_m: float) -> ArmSample:
    """Return the arm at rest with its tip at a height."""
    return ArmSample(
        stamp_ns=stamp_ns,
        controller_time_s=(stamp_ns - START_NS) * 1e-9,
        pose=Pose(position=(0.0, -0.4, z_m), rotation_vector=(0.0, 3.14, 0.0)),
        velocity=(0.0,) * 6,
        runtime_state=2,
        safety_bits=1,
        robot_mode=7,
    )


def write_recording(path: Path, made: SimpleNamespace) -> None:
    """Record 3.5 s of force, arm and images; the image shows the punch from 1.5 s on."""

    def jpeg(values: np.ndarray) -> bytes:
        framed = cv2.copyMakeBorder(made.to_image(values), 51, 51, 68, 68, cv2.BORDER_REPLICATE)
        large = cv2.resize(framed, (640, 480), interpolation=cv2.INTER_LINEAR)
        return bytes(cv2.imencode(".jpg", large[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 97])[1])

    unloaded = jpeg(made.background())
    pressed = jpeg(made.background() + made.contact_change(FORCE_N * 3))
    with RecordingWriter(path, metadata={}) as writer:
        for k in range(350):
            force = TARE_N + (FORCE_N if k >= 150 else 0.0)
            z = CONTACT_Z_M - (DEPTH_M if k >= 150 else -1e-3)
            counter = k if k < 100 else k + 3
            wrench = (0.0, 0.0, force, 0.0, 0.0, 0.0)
            stamp = at(k * 0.01)
            writer.write([ForceSample(stamp_ns=stamp, counter=counter, wrench=wrench)])
            writer.write([arm_at(stamp, z)])
            if k % 4 == 0:
                writer.write(
                    [
                        ImageFrame(
                            stamp_ns=stamp,
                            counter=k // 4,
                            device_stamp_s=None,
                            width=640,
                            height=480,
                            # After its end a JPEG may hold what it likes; no two are the same.
                            jpeg=(pressed if k >= 150 else unloaded) + k.to_bytes(2, "big"),
                        )
                    ]
                )


def replay_of(records: list[TrialRecord]) -> Replay:
    """Return a replay that matches within 0.02 N."""
    trials = tuple(
        ReplayTrial(
            index=r.index,
            force_measured_n=FORCE_N,
            force_simulated_n=FORCE_N + 0.02,
            depth_simulated_m=1.9e-4,
            force_error_estimate=0.03,
            force_error_basis="made up for this test",
            newton_iterations=9,
            search_iterations=3,
            wall_s={"solve": 1.0},
            balance_relative=1e-9,
            gap_min_m=1e-6,
            min_jacobian=0.8,
            force_history=((1e-4, 0.6), (1.9e-4, FORCE_N + 0.02), (2.5e-4, 1.7)),
        )
        for r in records
    )
    return Replay(name="main", trials=trials, model=made_model(), versions={"x": "1"})


@pytest.fixture
def store(tmp_path: Path, made: SimpleNamespace) -> RunStore:
    """A run of six targets of which the first was pressed, and the second failed unrecorded."""
    run = empty_run(tmp_path)
    path = run.paths.recording(1, 1)
    path.parent.mkdir(parents=True)
    write_recording(path, made)
    run.save_result(record(1))
    run.save_result(replace(record(2), outcome=Outcome.FAULT, reason="unplugged"))
    for name, detail in (("attempt-start", {}), ("fault", {"reason": "camera: silent"})):
        append_event(
            run.paths.journal,
            JournalEvent(stamp_ns=1, name=name, trial=2, attempt=1, detail=detail),
        )
    image = made.to_image(made.background() + made.contact_change(FORCE_N * 3))
    run.save_replay(replay_of([record(1)]), {1: ReplayFields(image=image)})
    return run


@pytest.fixture(scope="session")
def press() -> SimpleNamespace:
    """What the recorded press is made with, for tests that need another one."""
    return SimpleNamespace(
        at=at,
        arm_at=arm_at,
        record=record,
        replay_of=replay_of,
        write=write_recording,
        FORCE_N=FORCE_N,
        DEPTH_M=DEPTH_M,
    )
