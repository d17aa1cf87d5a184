"""Ball presses: their tables, and those of gels with markers."""

import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from sim.optics.calibrate.ball_press import (
    BallPress,
    Circle,
    check_presses_fit,
    read_ball_presses,
    read_rgb,
)
from sim.optics.calibrate.circle_and_light import PressScene, wrong_label
from sim.optics.calibrate.colour_fit import Calibration
from sim.optics.calibrate.gel_profile import ORTHOGRAPHIC, GelMotion, MotionModel, fit_motions
from sim.optics.calibrate.shadow_blur_fit import gel_motion, press_image
from sim.optics.markers.marker_tracking import find_markers
from tacauchy_rig.core.errors import ConfigError
from tests.sim.optics.synthetic_presses import press_scene, presses, true_model

HEADER = "image,center_x_px,center_y_px,radius_px\n"


def _folder(tmp_path: Path, table: str) -> Path:
    red_in_bgr = np.zeros((8, 10, 3), np.uint8)
    red_in_bgr[..., 2] = 200
    cv2.imwrite(str(tmp_path / "a.png"), red_in_bgr)
    (tmp_path / "circles.csv").write_text(table, encoding="utf-8")
    return tmp_path


def test_presses_are_read_as_rgb(tmp_path: Path) -> None:
    """Image, circle and colour order come as documented, whatever the order of the columns."""
    folder = _folder(tmp_path, "radius_px,note,image,center_y_px,center_x_px\n2,new,a.png,3.5,4\n")
    (press,) = read_ball_presses(folder, folder / "circles.csv")
    assert press.name == "a.png"
    assert press.image.shape == (8, 10, 3)
    assert press.image[0, 0].tolist() == [200, 0, 0]
    assert (press.circle.x_px, press.circle.y_px, press.circle.radius_px) == (4.0, 3.5, 2.0)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("image,x,y\na.png,1,2\n", "lacks the column center_x_px, center_y_px, radius_px"),
        (HEADER, "names no image"),
        (HEADER + "a.png,4,four,2\n", r"circles.csv, line 2: .*four"),
        (HEADER + "a.png,4,3\n", r"circles.csv, line 2"),
        (HEADER + "a.png,4,3,0\n", r"line 2: radius 0 px is not positive"),
        (HEADER + "b.png,4,3,1\n", r"b.png cannot be read: No such file"),
        (HEADER + "a.png,nan,3,1\n", r"line 2: center_x_px is nan"),
        (HEADER + "a.png,4,inf,1\n", r"line 2: center_y_px is inf"),
        ("radius_px,center_x_px,center_y_px,image\n2,4,3\n", r"line 2: names no image"),
    ],
)
def test_damaged_tables_are_refused(tmp_path: Path, table: str, message: str) -> None:
    """Every fault names the file, the line where there is one, and the value."""
    folder = _folder(tmp_path, table)
    with pytest.raises(ConfigError, match=message):
        read_ball_presses(folder, folder / "circles.csv")


def test_a_spreadsheets_byte_order_mark_is_no_column(tmp_path: Path) -> None:
    """What a spreadsheet saves as UTF-8 is read; what it saves otherwise is refused as such."""
    folder = _folder(tmp_path, "\ufeff" + HEADER + "a.png,4,3.5,2\n")
    assert len(read_ball_presses(folder, folder / "circles.csv")) == 1
    (folder / "circles.csv").write_bytes((HEADER + "prüfung.png,4,3.5,2\n").encode("latin-1"))
    with pytest.raises(ConfigError, match=r"circles.csv is no CSV[\s\S]*UTF-8"):
        read_ball_presses(folder, folder / "circles.csv")


@pytest.mark.parametrize(
    ("circle", "message"),
    [
        ((-1.0, 3.0), r"a.png: its circle is around column -1, row 3, outside .* 10 x 8 px"),
        ((4.0, 1000.0), r"around column 4, row 1000, outside"),
    ],
)
def test_contacts_outside_the_image_are_refused(circle: tuple[float, float], message: str) -> None:
    """A circle around no pixel is named with its place and the image's size."""
    image = np.zeros((8, 10, 3), np.uint8)
    press = BallPress(
        name="a.png", image=image, circle=Circle(x_px=circle[0], y_px=circle[1], radius_px=2.0)
    )
    with pytest.raises(ConfigError, match=message):
        check_presses_fit([press], image)


def test_missing_table_is_refused(tmp_path: Path) -> None:
    """The message names the columns that are wanted."""
    with pytest.raises(ConfigError, match=r"circles.csv cannot be read[\s\S]*center_x_px"):
        read_ball_presses(tmp_path, tmp_path / "circles.csv")


def test_text_is_no_image(tmp_path: Path) -> None:
    """A file that is no image is refused by name."""
    (tmp_path / "a.png").write_text("not an image", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"a.png is no whole PNG"):
        read_rgb(tmp_path / "a.png")


TRUE = MotionModel(per_distance=40.0, slide=0.7)
BALL_RADIUS_M = 2.35e-3
_FOUND = r"contact at (\d+), (\d+), .* explains (\d+)% .* the label (\d+)%"


def _marked_scene() -> PressScene:
    """Print irregular dots over the frame."""
    scene, rng = press_scene(), np.random.default_rng(8)
    frame = scene.background.copy()
    rows, columns = np.mgrid[: frame.shape[0], : frame.shape[1]]
    for y in range(10, 150, 18):
        for x in range(9, 180, 18):
            at, radius = rng.uniform(-3, 3, 2) + np.array([x, y]), rng.uniform(2.5, 4.0)
            cover = np.clip(radius - np.hypot(columns - at[0], rows - at[1]) + 0.5, 0.0, 1.0)
            frame += cover[..., None] * ((30.0, 34.0, 28.0) - frame)
    markers = find_markers(np.rint(frame).astype(np.uint8))
    assert markers is not None
    return replace(scene, markers=markers, background=markers.bare.astype(np.float64))


def _calibration(scene: PressScene, motion: MotionModel) -> Calibration:
    return Calibration(
        model=true_model(), scene=scene, circles=(), lights=np.zeros((0, 3, 3)), motion=motion
    )


def _pressed(scene: PressScene, count: int) -> tuple[list[BallPress], list[GelMotion]]:
    """Render presses that take the gel along, over images that drift."""
    rng, plain = np.random.default_rng(3), presses(count, noise=0.0)[0]
    model = _calibration(scene, TRUE)
    made, motions = [], []
    for press in plain:
        motion = GelMotion(
            own_px=rng.normal(0.0, 1.0, 12) * ([1.5] * 2 + [0.4] * 6 + [1.0] + [0.2] * 3),
            error_px=np.zeros(0),
            under=np.zeros(0, dtype=np.bool_),
        )
        image = press_image(model, press.circle, motion) + rng.normal(0.0, 1.0, (150, 180, 3))
        shown = np.clip(np.rint(image), 0, 255).astype(np.uint8)
        made.append(scene.followed(replace(press, image=shown)))
        motions.append(motion)
    return made, motions


def test_the_motion_of_markers_is_found() -> None:
    """Distance, sliding, and how each ball slid and turned come back from tracked markers."""
    scene = _marked_scene()
    made, motions = _pressed(scene, 6)
    tracks = [press.tracks for press in made if press.tracks is not None]
    circles = [press.circle for press in made]
    found, own = fit_motions(tracks, circles, scene.profile, scene.geometry)
    assert found.per_distance == pytest.approx(TRUE.per_distance, rel=0.2)
    for each, true, press in zip(own, motions, made, strict=True):
        assert np.median(each.error_px) < 0.1
        assert each.own_px[8] == pytest.approx(true.own_px[8], abs=0.3)
        fields = [
            gel_motion(_calibration(scene, by), press.circle, motion)
            for by, motion in ((found, each), (TRUE, true))
        ]
        assert np.median(np.linalg.norm(fields[0] - fields[1], axis=0)) < 0.1


def test_markers_hide_the_gel_where_they_are() -> None:
    """What a press does not show of the gel are its markers, before and after, and no more."""
    scene = _marked_scene()
    made, _ = _pressed(scene, 2)
    for press in made:
        bare = _calibration(replace(scene, markers=None), ORTHOGRAPHIC)
        off = np.abs(press.image - press_image(bare, press.circle))
        assert off[press.shown].max() < 16.0
        assert press.shown.mean() > 0.4


def test_a_wrong_label_is_named_with_evidence() -> None:
    """A circle beside the contact is contradicted by its image; right ones are not."""
    scene = _marked_scene()
    press = _pressed(scene, 1)[0][0]
    assert wrong_label(press, scene, ball_radius_m=BALL_RADIUS_M) is None
    label = press.circle._replace(x_px=press.circle.x_px + 45.0)
    wrong = wrong_label(replace(press, circle=label), scene, ball_radius_m=BALL_RADIUS_M)
    assert wrong is not None
    assert "0000.png was left out: its label says column" in wrong
    x, y, explained, as_labelled = map(float, re.findall(_FOUND, wrong)[0])
    assert press.circle.distance(np.float64(x), np.float64(y)) < 4.0
    assert explained > 60 > 30 > as_labelled
