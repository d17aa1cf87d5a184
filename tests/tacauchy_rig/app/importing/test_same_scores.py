"""A run in others' formats, imported, replayed and reported: the scores of the run itself."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from reports.comparison.results import TrialResult
from tacauchy_rig.app.importing.importer import import_run
from tacauchy_rig.app.replay import replay
from tacauchy_rig.core.store.run_store import RunStore
from tests.recorded_run import coarse_sensor, new_run, press_run
from tests.tacauchy_rig.app.importing.same_scores import FORMATS, scored

REPLAY = (
    'replay.preset="fast"',
    'replay.pose="stated"',
    'replay.modulus="stated"',
)
LOST = dict(zip(FORMATS, (1e-9, 5e-3, 5e-3), strict=True))
"""Of a force or a depth, relative: windows are told by the CSV and found in the others."""
LOST_SSIM = dict(zip(FORMATS, (1e-6, 2e-3, 2e-3), strict=True))
"""Other frames are in a window that was found: their noise is another."""


@pytest.fixture(scope="module", autouse=True)
def _no_uncertainties() -> Iterator[None]:
    """Leave out the coarse presses that no score depends on."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(replay, "_uncertainties", lambda parts, *_: ([() for _ in parts], None))
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
    kind: str,
    own: tuple[RunStore, tuple[TrialResult, ...]],
    tmp_path: Path,
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
