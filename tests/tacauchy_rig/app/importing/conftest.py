"""A run of the mock rig, and sources in others' formats that are made of it."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from tacauchy_rig.core.store.run_store import RunStore
from tests.recorded_run import pressed_run

NO_CONTACT, PRESSED = "rest.png", "press.png"
SPEC = """
kind = "csv"
[data]
no_contact = "rest.png"
[data.columns]
image = "image"
force = { column = "fz", unit = "N" }
depth = { column = "depth", unit = "mm" }
[rig.sensor]
name = "gelsight-mini"
[rig.replay]
indenter = "sphere:diameter=4mm"
"""


@pytest.fixture(scope="session")
def ours(tmp_path_factory: pytest.TempPathFactory) -> RunStore:
    """Two presses of the mock rig."""
    return pressed_run(tmp_path_factory.mktemp("ours"))


def image(level: int) -> bytes:
    """Return a PNG of 640 x 480 px of one colour."""
    return bytes(cv2.imencode(".png", np.full((480, 640, 3), level, np.uint8))[1])


def make_small(folder: Path) -> Path:
    """Write a folder of one press that imports as it is."""
    folder.mkdir()
    (folder / "import.toml").write_text(SPEC)
    (folder / "presses.csv").write_text("image,fz,depth\npress.png,1.5,0.25\n")
    (folder / NO_CONTACT).write_bytes(image(90))
    (folder / PRESSED).write_bytes(image(120))
    return folder


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """A folder of one press."""
    return make_small(tmp_path / "small")
