"""Taxim's ball presses come back as runs that their optics can be calibrated from."""

import io
import zipfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from sim.scene.scene import Preset
from tacauchy_rig.app.calibration.optics.from_folder import read_input
from tacauchy_rig.app.calibration.optics.from_run import request_of
from tacauchy_rig.app.importing.importer import import_run
from tacauchy_rig.app.replay.open_run import open_run
from tacauchy_rig.app.replay.report_run import report_run
from tacauchy_rig.core.errors import RigError
from tacauchy_rig.core.image_codec import encode_png
from tacauchy_rig.core.run import CalibratedOptics, HeldOutPress, ImageAgreement
from tacauchy_rig.core.store.recording.mcap_reader import Recording
from tacauchy_rig.core.store.run_store import RunStore

PRESSES = 6
SHAPE = (480, 640, 3)
ARRAYS: dict[str, Any] = {
    "f0": np.full(SHAPE, (10, 20, 30), np.uint8),
    "imgs": np.stack([np.full(SHAPE, (50 + k, 60, 70), np.uint8) for k in range(PRESSES)]),
    "touch_center": np.array([(300.0, 200.0 + 10 * k) for k in range(PRESSES)]),
    "touch_radius": np.full(PRESSES, 60),
}
AGREEMENT = ImageAgreement(
    r2=0.9876,
    mae_levels=2.25,
    ssim=0.97,
    r2_no_contact=-0.07,
    mae_no_contact_levels=23.8,
    ssim_no_contact=0.89,
)


def wheel(folder: Path, name: str = "gelsight", **changed: Any) -> Path:
    """Write a wheel with one set, some of its arrays changed; None leaves one out."""
    packed = io.BytesIO()
    arrays = {key: value for key, value in {**ARRAYS, **changed}.items() if value is not None}
    np.savez(packed, **arrays)
    path = folder / "taxim-1.4.1-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as file:
        file.writestr(f"taxim/calib/{name}/dataPack.npz", packed.getvalue())
    return path


def imported(folder: Path, name: str = "gelsight", **changed: Any) -> RunStore:
    """Import a set of a wheel."""
    return import_run(wheel(folder, name, **changed), parent=folder, overrides=[f"data.set={name}"])


def test_a_set_becomes_a_run(tmp_path: Path) -> None:
    """Its images in red, green, blue; its circles; and neither force, depth nor place."""
    store = imported(tmp_path)
    assert store.config.sensor.name == "taxim-gelsight"
    assert store.config.replay.indenter == "sphere:diameter=4mm"
    trials = store.imported_trials
    assert len(trials) == PRESSES
    assert trials[3].contact_px == (300.0, 220.0, 60.0)
    assert (trials[3].place_m, trials[3].streams) == (None, ("image",))
    record = store.counting(3)
    assert record is not None
    assert (record.force_measured_n, record.depth_measured_m) == (None, None)
    frames = [frame.jpeg for frame in Recording.open(store.paths.recording(3, 1)).frames()]
    colours = [
        cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[0, 0].tolist()
        for data in frames
    ]
    assert colours == [[10, 20, 30], [52, 60, 70]]  # blue first, as OpenCV and the set have them


def test_what_nobody_says_of_the_ball_is_said(tmp_path: Path) -> None:
    """The Mini's ball and scale are not stated, and its circles are none of its contacts."""
    store = imported(tmp_path, "gelsight_mini")
    found = store.imported.load()
    assert found is not None
    assert found.trials[0].contact_px is None
    assert "ball" in found.unknown[0]
    assert any("wrong by the same factor" in note for note in found.notes)


def test_optics_are_calibrated_from_the_run(tmp_path: Path) -> None:
    """Ball and scale are the run's, the images and circles lie where the calibration reads them."""
    run = open_run(imported(tmp_path).paths.root)
    given = dict.fromkeys(
        ("background", "ball_diameter_m", "scale_px_m", "out", "sensor", "circles", "check")
    )
    request = request_of(run.store.paths.root, run, **given, preset=Preset.FAST, folds=3, jobs=1)
    assert request.ball_diameter_m == pytest.approx(4e-3)
    assert request.scale_px_m == pytest.approx((33898.3, 33898.3), rel=1e-5)
    assert request.out == run.store.paths.root / "optics" / "calibration.npz"
    _, read, _ = read_input(request)
    assert [press.circle.y_px for press in read.presses] == [200.0 + 10 * k for k in range(6)]
    assert read.presses[1].image[0, 0].tolist() == [70, 60, 51]
    assert read.background[0, 0].tolist() == [30, 20, 10]


def test_the_report_has_the_scores_beside_no_contact(tmp_path: Path) -> None:
    """What was cross-validated stands on the page, in the summary, and with its picture."""
    store = imported(tmp_path)
    press = HeldOutPress(
        trial=1, contact_px=(300.0, 200.0, 60.0), nudged_px=(1.0, 0.0, 0.0), mae_levels=2.0
    )
    store.optics.save(
        CalibratedOptics(
            ball_diameter_m=4e-3,
            scale_px_m=(33898.0, 33898.0),
            sensor="made",
            preset="fast",
            labelled=True,
            folds=3,
            crop_px=240,
            nudged=AGREEMENT,
            as_labelled=AGREEMENT,
            no_contact_light=AGREEMENT,
            presses=(press,),
        )
    )
    store.paths.optics.mkdir()
    store.paths.calibration_picture.write_bytes(encode_png(np.zeros((8, 8, 3), np.uint8)))
    report, paths = report_run(open_run(store.paths.root))
    page = paths.html.read_text()
    assert not report.passed
    for text in ("0.9876", "2.25", "23.8", "0.890", "the ball diameter (4.00 mm)"):
        assert text in page
    assert (paths.images / "optics-held-out.png").is_file()


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"imgs": None}, "has no imgs.npy"),
        ({"imgs": np.array([{"a": 1}], dtype=object)}, "pickles are never loaded"),
        ({"imgs": ARRAYS["imgs"].astype(np.float32)}, "imgs is"),
        ({"f0": ARRAYS["f0"][::2]}, "imgs is"),
        ({"f0": ARRAYS["f0"][..., 0]}, "f0 is"),
        ({"touch_radius": np.full(PRESSES, -1)}, "press 1 has its circle"),
        ({"touch_center": np.full((PRESSES, 2), np.nan)}, "press 1 has its circle"),
        ({"touch_radius": np.full(PRESSES + 1, 60)}, "circles for 6 images"),
        ({"imgs": ARRAYS["imgs"][:0], "touch_center": np.zeros((0, 2)), "touch_radius": []}, "0 p"),
    ],
)
def test_odd_arrays_are_refused(changed: dict[str, Any], told: str, tmp_path: Path) -> None:
    """By the array's name, and no run is left behind."""
    with pytest.raises(RigError, match=told):
        imported(tmp_path, **changed)
    assert not list(tmp_path.glob("*taxim-gelsight"))
