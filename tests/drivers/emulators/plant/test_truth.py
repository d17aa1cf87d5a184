"""The emulated world's truth: a function of the seed alone."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.emulators.plant.truth import PlantTruth, draw_truth, read_truth, write_truth
from tacauchy_rig.core.errors import RecordError


def test_another_process_draws_the_same_world(tmp_path: Path) -> None:
    """Emulators in separate processes agree without talking to each other."""
    program = (
        "import sys, pathlib; from drivers.emulators.plant.truth import *;"
        "write_truth(pathlib.Path(sys.argv[1]), draw_truth(7))"
    )
    subprocess.run([sys.executable, "-c", program, str(tmp_path)], check=True, cwd=Path.cwd())
    assert read_truth(tmp_path / "truth.json") == draw_truth(7)


@given(st.integers(0, 2**31))
def test_every_world_is_believable(seed: int) -> None:
    """Spread stays within what units of one sensor show."""
    truth = draw_truth(seed)
    assert 0.39e6 < truth.young_pa < 0.48e6
    assert 0.47 <= truth.poisson <= 0.49
    assert 0.05 <= sum(truth.relaxation_weights) <= 0.08
    assert 1e-4 <= sum(value**2 for value in truth.pose_error_m) ** 0.5 <= 3.0001e-4
    assert 0.005 <= truth.force_noise_n <= 0.010
    assert abs(truth.force_drift_n_s) < 1e-3


def test_units_are_in_the_keys(tmp_path: Path) -> None:
    """Whoever opens truth.json needs no manual."""
    content = json.loads(write_truth(tmp_path, draw_truth(1)).read_text())
    assert {"young_pa", "surface_error_m", "force_latency_s", "tilt_rad"} <= set(content)


def test_a_broken_truth_file_is_refused(tmp_path: Path) -> None:
    """A file without the fields names itself."""
    path = tmp_path / "truth.json"
    path.write_text("{}")
    with pytest.raises(RecordError, match=r"truth\.json"):
        read_truth(path)


def test_worlds_are_hashable_and_plain() -> None:
    """A truth is a value: equal, hashable, usable as a cache key."""
    assert isinstance(hash(draw_truth(5)), int)
    assert PlantTruth.__slots__
