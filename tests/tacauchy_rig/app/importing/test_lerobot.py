"""Episodes of a LeRobot dataset come back as presses."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from tacauchy_rig.app.importing.importer import import_run
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.rgb import decode_rgb
from tacauchy_rig.core.store.check.run import check_run
from tacauchy_rig.core.store.recording.reading import Recording
from tests.tacauchy_rig.app.importing.made import make_lerobot
from tests.tacauchy_rig.app.importing.sources import counting

LOSS = 5.0  # grey levels that the codec takes; the presses are 20 apart


@pytest.mark.parametrize("kind", ["image", "video"])
def test_episodes_become_presses(kind: str, tmp_path: Path) -> None:
    """Each with its force, its depth, and images of its own time in files of many episodes."""
    store = import_run(make_lerobot(tmp_path / "source", kind=kind), parent=tmp_path)
    assert check_run(store).passed, list(check_run(store).missed())
    trials = counting(store)
    assert [each.force_measured_n for each in trials] == pytest.approx([2.0, 3.0])
    depths = [each.depth_measured_m for each in trials]
    assert depths == pytest.approx([0.2e-3, 0.3e-3], abs=1e-9)
    for trial, newton in zip(trials, (2.0, 3.0), strict=True):
        recording = Recording.open(store.paths.recording(trial.index, 1))
        held = recording.frames(trial.dwell_start_ns, trial.dwell_end_ns)
        images = [decode_rgb(frame.jpeg) for frame in held]
        levels = [float(np.mean(image)) for image in images if image is not None]
        assert len(levels) == 50
        assert levels == pytest.approx([90 + 20 * newton] * len(levels), abs=LOSS)
    assert store.imported_trials[2].name.startswith("episode 1, press 1")


def test_episodes_are_taken_by_number(tmp_path: Path) -> None:
    """One of them alone."""
    source = make_lerobot(tmp_path / "source")
    store = import_run(source, parent=tmp_path, overrides=["data.episodes=[1]"])
    assert [each.force_measured_n for each in counting(store)] == pytest.approx([3.0])


def test_without_its_extra_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The reader of Parquet is no part of a plain installation."""
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(ConfigError, match="pyarrow") as refused:
        import_run(make_lerobot(tmp_path / "source"), parent=tmp_path)
    assert "pip install" in refused.value.remedy
