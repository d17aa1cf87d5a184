"""Tables of presses: by indenter, in SI, and refused with the line that is wrong."""

from pathlib import Path

import numpy as np
import pytest

from tacauchy_rig.app.calibration.material.measured_presses import IndenterPresses, read_presses
from tacauchy_rig.core.errors import ConfigError, RecordError

TABLE = """indenter,press,depth_mm,force_n
sphere:diameter=6mm,a,0.1,0.05
sphere:diameter=6mm,a,0.3,0.25
sphere:diameter=6mm,b,0.3,0.26
"cylinder:diameter=4mm,fillet=0.5mm",,0.2,1.1
"cylinder:diameter=4mm,fillet=0.5mm",,0.4,2.3
"""


def _read(path: Path, text: str, *overrides: str) -> list[IndenterPresses]:
    path.write_text(text)
    return read_presses([path], overrides=overrides, noise_n=0.02, contact_force_n=0.05)


def test_a_table_has_a_group_for_each_indenter(tmp_path: Path) -> None:
    """Lines of one press share it; those that name none are presses of their own."""
    ball, punch = _read(tmp_path / "presses.csv", TABLE)
    assert ball.name == "sphere:diameter=6mm"
    assert ball.press.tolist() == [0, 0, 1]
    assert ball.depth_m == pytest.approx([1e-4, 3e-4, 3e-4])
    assert punch.press.tolist() == [0, 0]
    assert punch.force_n.tolist() == [1.1, 2.3]
    assert np.all(punch.noise_n == 0.02)
    assert punch.contact_force_n == 0.05


def test_repeats_tell_the_noise(tmp_path: Path) -> None:
    """Where they scatter by more than is stated."""
    ball, punch = _read(tmp_path / "presses.csv", TABLE.replace("0.26", "0.35"))
    assert ball.scatter_n == pytest.approx(0.1 / 2**0.5)
    assert np.all(ball.noise_n == ball.scatter_n)
    assert punch.scatter_n is None


def test_two_tables_of_one_indenter_are_one_group(tmp_path: Path) -> None:
    """Their presses stay apart."""
    for name in ("one.csv", "two.csv"):
        (tmp_path / name).write_text(TABLE)
    paths = [tmp_path / "one.csv", tmp_path / "two.csv"]
    ball, _ = read_presses(paths, overrides=(), noise_n=0.02, contact_force_n=0.0)
    assert ball.press.tolist() == [0, 0, 1, 2, 2, 3]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("depth,force\n1,2\n", 'no column "indenter"'),
        (TABLE.replace("0.25", "-0.25"), "line 3: depth_mm '0.3' and force_n '-0.25'"),
        (TABLE.replace("0.25", "soft"), "line 3"),
        (TABLE.replace("0.25", "nan"), "line 3"),
    ],
)
def test_what_is_no_press_is_refused(tmp_path: Path, text: str, message: str) -> None:
    """With its line, and what stands there."""
    with pytest.raises(RecordError) as refused:
        _read(tmp_path / "presses.csv", text)
    assert message in str(refused.value)


def test_a_gel_of_layers_and_a_folder_that_is_no_run_are_refused(tmp_path: Path) -> None:
    """Forces do not say which layer is soft."""
    with pytest.raises(ConfigError, match="layers"):
        _read(tmp_path / "presses.csv", TABLE, 'sensor.name="9dtact"')
    with pytest.raises(ConfigError, match="plane"):
        _read(tmp_path / "presses.csv", TABLE.replace("sphere:diameter=6mm", "plane"))
    with pytest.raises(RecordError):
        read_presses([tmp_path], overrides=(), noise_n=0.02, contact_force_n=0.0)
