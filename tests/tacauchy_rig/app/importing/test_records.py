"""NumPy records come back as the presses that they hold."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tacauchy_rig.app.importing.importer import import_run
from tacauchy_rig.core.rgb import decode_rgb
from tacauchy_rig.core.store.check.run import check_run
from tacauchy_rig.core.store.recording.reading import Recording
from tests.tacauchy_rig.app.importing.made import BLUE, RED, make_records, record
from tests.tacauchy_rig.app.importing.sources import counting


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """Two straight presses of a ball and a punch, and one that slides."""
    return make_records(tmp_path / "source")


def test_records_become_presses(source: Path, tmp_path: Path) -> None:
    """Force, depth, place and indenter as told; red is red; who slides is left out and counted."""
    store = import_run(source, parent=tmp_path)
    assert check_run(store).passed, list(check_run(store).missed())
    ball, punch = counting(store)
    assert (ball.force_measured_n, ball.depth_measured_m) == pytest.approx((2.5, 0.4e-3))
    assert (punch.force_measured_n, punch.depth_measured_m) == pytest.approx((4.0, 0.3e-3))
    told = store.imported_trials
    assert [each.name for each in told.values()] == ["1_sphere_10", "2_cylinder_5"]
    assert told[1].place_m == pytest.approx((1.5e-3, -2e-3))
    assert told[1].indenter == "sphere:diameter=10mm"
    frames = [each.jpeg for each in Recording.open(store.paths.recording(1, 1)).frames()]
    rest, pressed = (decode_rgb(data) for data in frames)
    assert rest is not None
    assert pressed is not None
    assert rest[0, 0].tolist() == [90, 90, 90]
    assert pressed[0, 0].tolist() == [RED, 60, BLUE]
    imported = store.imported.load()
    assert imported is not None
    assert any("1 records were left out" in note for note in imported.notes)


def test_a_structured_array_is_a_record(source: Path, tmp_path: Path) -> None:
    """An array with named fields needs no archive."""
    values = {key: np.asarray(value) for key, value in record(fz=3.0).items()}
    kind = [(key, value.dtype, value.shape) for key, value in values.items()]
    np.save(source / "feats/4_sphere_10.npy", np.array([tuple(values.values())], dtype=kind))
    store = import_run(source, parent=tmp_path)
    assert counting(store)[2].force_measured_n == pytest.approx(3.0)


def test_what_was_unpickled_elsewhere_takes_the_pickles_place(source: Path, tmp_path: Path) -> None:
    """The pickle that lies beside it is not touched."""
    np.save(source / "feats/1_sphere_10.npy", np.array(record(), dtype=object), allow_pickle=True)
    assert len(counting(import_run(source, parent=tmp_path))) == 2
