"""Folders of ball presses and what is wrong with them."""

from __future__ import annotations

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
from tacauchy_rig.core.errors import ConfigError

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
    with pytest.raises(ConfigError, match=r"a.png is not an image"):
        read_rgb(tmp_path / "a.png")
