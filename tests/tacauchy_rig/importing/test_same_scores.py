"""A run in others' formats, imported, replayed and reported: the scores of the run itself."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from reports.comparison.results import TrialResult
from tacauchy_rig.importing.importer import import_run
from tacauchy_rig.loop.opening import open_run
from tacauchy_rig.loop.replay import replay_run
from tacauchy_rig.loop.report import report_run
from tacauchy_rig.registry import Kind, load
from tacauchy_rig.store.run_store import RunStore
from tests.recorded_run import new_run, press_run
from tests.tacauchy_rig.importing.sources import write_bag, write_csv, write_video

REPLAY = (
    'replay.preset="fast"',
    'replay.pose="stated"',
    'replay.modulus="stated"',
)
LOST = {"csv": 1e-9, "bag": 5e-3, "video": 5e-3}
"""Of a force or a depth, relative: windows are told by the CSV and found in the others."""
LOST_SSIM = {"csv": 1e-6, "bag": 2e-3, "video": 2e-3}
"""Other frames are in a window that was found: their noise is another."""


def _small_sensor(folder: Path) -> str:
    """Write a GelSight Mini whose frames are the mock camera's, and return its path."""
    text = load(Kind.SENSOR, "gelsight-mini").read_text("utf-8")
    text = text.replace("width = 320", "width = 32").replace("height = 240", "height = 24")
    path = folder / "small.toml"
    path.write_text(text.replace("0.0634 mm", "0.634 mm"))
    return str(path)


def _write_later(store: RunStore, folder: Path) -> Path:
    return write_video(store, folder, later_s=0.7)


def _trials(store: RunStore) -> tuple[TrialResult, ...]:
    replay_run(open_run(store.paths.root))
    return report_run(open_run(store.paths.root))[0].trials


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> tuple[RunStore, tuple[TrialResult, ...]]:
    """A run of the mock rig, and what its report says."""
    folder = tmp_path_factory.mktemp("own")
    store = new_run(folder, *REPLAY, f"sensor.name={_small_sensor(folder)}")
    press_run(store)
    return store, _trials(store)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "write"), [("csv", write_csv), ("bag", write_bag), ("video", _write_later)]
)
def test_scores_are_those_of_the_run_itself(
    kind: str,
    write: Callable[[RunStore, Path], Path],
    own: tuple[RunStore, tuple[TrialResult, ...]],
    tmp_path: Path,
) -> None:
    """To what the format loses: forces, depths, SSIM, and the contact's residual."""
    store, expected = own
    given = (*REPLAY, f"sensor.name={store.config.sensor.name}")
    overrides = [f"rig.{each}" for each in given]
    found = _trials(import_run(write(store, tmp_path / kind), parent=tmp_path, overrides=overrides))
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
