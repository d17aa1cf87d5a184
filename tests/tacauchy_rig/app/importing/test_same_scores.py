"""A recorded run in others' formats, with calibrated optics: the scores of each beside its own.

``python -m tests.tacauchy_rig.app.importing.test_same_scores RUN OPTICS.npz`` prints a table; RUN
is one of `dry-run --press-only --set 'replay.pose="stated"'`, OPTICS.npz is what `calibrate optics`
writes of `emulate presses` of the same seed.
"""

import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from reports.comparison.result_types import TrialResult
from sim.sensor.sensor import Sensor
from tacauchy_rig.app.importing.importer import import_run
from tacauchy_rig.app.replay import replay
from tacauchy_rig.app.replay.chosen_optics import OpticalCalibration, optics_of
from tacauchy_rig.app.replay.open_run import open_run
from tacauchy_rig.app.replay.replay import replay_run
from tacauchy_rig.app.replay.report_run import report_run
from tacauchy_rig.core.store.run_store import RunStore
from tests.recorded_run import coarse_sensor, new_run, press_run
from tests.tacauchy_rig.app.importing.sources import write_bag, write_csv, write_video

LATER_S = 0.7
Write = Callable[[RunStore, Path], Path]
FORMATS: dict[str, Write] = {
    "a folder with CSV": write_csv,
    "a ROS 2 bag": write_bag,
    "a video and a log": partial(write_video, later_s=LATER_S),
}


def calibrated(file: str, sensor: Sensor) -> OpticalCalibration:
    """Return the optics of a file, as an imported run names it."""
    return optics_of(file, sensor, calibrate=None)


def scored(store: RunStore, optics: str = "") -> tuple[TrialResult, ...]:
    """Replay and report a run."""
    calibrate = partial(calibrated, optics) if optics else None
    replay_run(open_run(store.paths.root), calibrate=calibrate)
    return report_run(open_run(store.paths.root))[0].trials


def as_imported(store: RunStore, write: Write, folder: Path, optics: str) -> RunStore:
    """Write a run in another format and import that, with all else that its rig.toml says."""
    config = store.config
    said = {
        "sensor.name": config.sensor.name,
        "sensor.optics_calibration": optics,
        "replay.preset": config.replay.preset,
        "replay.pose": config.replay.pose.value,
    }
    overrides = [f'rig.{field}="{value}"' for field, value in said.items()]
    overrides.append(f"rig.replay.friction={config.replay.friction}")
    return import_run(write(store, folder), parent=folder.parent, overrides=overrides)


REPLAY = ('replay.preset="fast"', 'replay.pose="stated"', 'replay.modulus="stated"')
LOST = dict(zip(FORMATS, (1e-9, 5e-3, 5e-3), strict=True))
"""Of a force or a depth, relative: windows are told by the CSV and found in the others."""
LOST_SSIM = dict(zip(FORMATS, (1e-6, 2e-3, 2e-3), strict=True))
"""Other frames are in a window that was found: their noise is another."""


@pytest.fixture(scope="module", autouse=True)
def _no_uncertainties() -> Iterator[None]:
    """Leave out the coarse presses that no score depends on."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(
            replay, "_uncertainties", lambda _run, parts, *_: ([() for _ in parts], None)
        )
        yield


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> tuple[RunStore, tuple[TrialResult, ...]]:
    """A run of the mock rig, and what its report says."""
    folder = tmp_path_factory.mktemp("own")
    store = new_run(folder, *REPLAY, f"sensor.name={coarse_sensor(folder, 10)}")
    press_run(store)
    return store, scored(store)


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.parametrize("kind", FORMATS)
def test_scores_are_those_of_the_run_itself(
    kind: str, own: tuple[RunStore, tuple[TrialResult, ...]], tmp_path: Path
) -> None:
    """To what the format loses: forces, depths, SSIM, and the contact's residual."""
    store, expected = own
    given = (*REPLAY, f"sensor.name={store.config.sensor.name}")
    overrides = [f"rig.{each}" for each in given]
    source = FORMATS[kind](store, tmp_path / "source")
    found = scored(import_run(source, parent=tmp_path, overrides=overrides))
    lost = LOST[kind]
    assert len(found) == len(expected) == 2
    for theirs, ours in zip(found, expected, strict=True):
        assert theirs.force_measured_n == pytest.approx(ours.force_measured_n, rel=lost)
        assert theirs.depth_measured_m == pytest.approx(ours.depth_measured_m, abs=1e-5)
        assert theirs.depth_simulated_m == pytest.approx(ours.depth_simulated_m, rel=lost + 1e-6)
        assert theirs.metrics is not None
        assert ours.metrics is not None
        assert theirs.metrics.ssim == pytest.approx(ours.metrics.ssim, abs=LOST_SSIM[kind])
        assert theirs.contact is not None
        assert ours.contact is not None
        assert theirs.contact.relative_residual == pytest.approx(
            ours.contact.relative_residual, rel=0.02
        )


def _means(trials: Sequence[TrialResult]) -> list[float]:
    """Return SSIM, residual and mean error of the contact, force and prediction: their means."""
    rows = [
        (
            t.metrics.ssim,
            t.contact.relative_residual,
            t.contact.error_levels,
            t.force_measured_n or np.nan,
            1e3 * (t.depth_simulated_m or np.nan),
            100.0 * (t.force.prediction_error_relative or np.nan),
        )
        for t in trials
        if t.metrics is not None and t.contact is not None
    ]
    return np.mean(rows, axis=0).tolist()


def _worst(trials: Sequence[TrialResult], own: Sequence[TrialResult]) -> str:
    """Return the largest difference of SSIM and residual between a press and its own."""
    pairs = [(t.metrics, o.metrics, t.contact, o.contact) for t, o in zip(trials, own, strict=True)]
    known = [(m, n, c, d) for m, n, c, d in pairs if m and n and c and d]
    ssim = max(abs(m.ssim - n.ssim) for m, n, _, _ in known)
    residual = max(abs(c.relative_residual - d.relative_residual) for _, _, c, d in known)
    return f"{ssim:.4f}, {residual:.4f}"


def main(run: str, optics: str) -> None:
    """Print the table."""
    store = RunStore.open(Path(run))
    own = scored(store, optics)
    rows = [("the run itself", own, "")]
    with tempfile.TemporaryDirectory() as folder:
        for number, (name, write) in enumerate(FORMATS.items()):
            imported = as_imported(store, write, Path(folder) / str(number) / "source", optics)
            trials = scored(imported)
            rows.append((name, trials, _worst(trials, own)))
    head = (
        "| presses of | SSIM | residual | mean error [levels] | force [N] | simulated depth [mm] "
        "| force predicted [%] | largest difference of SSIM, residual |"
    )
    lines = [
        f"| {name} | {s:.5f} | {r:.4f} | {e:.3f} | {f:.4f} | {d:.4f} | {p:+.2f} | {worst} |"
        for name, trials, worst in rows
        for s, r, e, f, d, p in [_means(trials)]
    ]
    sys.stdout.write("\n".join([head, "|---|---|---|---|---|---|---|---|", *lines, ""]))


if __name__ == "__main__":
    main(*sys.argv[1:])
