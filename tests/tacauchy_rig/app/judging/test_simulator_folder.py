"""A simulator's folder, whole and in every way damaged, and a baseline without mechanics."""

import io
import os
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from sim.scene.indenter import Sphere
from sim.scene.pad import BoxPad
from sim.sensor.camera_geometry import CameraGeometry
from tacauchy_rig.app.judging.simulator_folder import Asked, read_outputs
from tacauchy_rig.app.judging.task_and_baseline import rigid_heights, write_outputs
from tacauchy_rig.core.errors import RigError
from tacauchy_rig.core.simulated import Driven, Outputs, PressOutput, Simulator

WIDTH, HEIGHT = 24, 16
COLOUR = np.array([40, 90, 200], dtype=np.uint8)


def _image(step: int) -> np.ndarray:
    image = np.broadcast_to(COLOUR, (HEIGHT, WIDTH, 3)).copy()
    image[4:8, 4:8] += np.uint8(step)
    return image


ASKED = Asked(
    trials=(1, 2, 3), size_px=(WIDTH, HEIGHT), references={i: _image(0) for i in (1, 2, 3)}
)
SIMULATOR = Simulator(
    name="Other é",
    version="0.1",
    milliseconds_an_image=12.5,
    machine='a "quoted" one',
    fitted_to_these=True,
    driven_by=Driven.DEPTH,
    note="two\nlines",
)


def _outputs() -> Outputs:
    grid = np.arange(HEIGHT * WIDTH, dtype=np.float64).reshape(HEIGHT, WIDTH)
    return Outputs(
        simulator=SIMULATOR,
        presses={
            i: PressOutput(
                image=_image(i),
                force_n=0.5 * i,
                height_m=-1e-6 * grid,
                pressure_pa=10.0 * grid,
                shear_pa=np.stack([grid, -2.0 * grid], axis=-1),
            )
            for i in (1, 3)
        },
        left_out=(2,),
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A whole folder."""
    place = tmp_path / "theirs"
    write_outputs(place, _outputs())
    return place


def test_what_was_written_is_read(folder: Path) -> None:
    """All of it comes back, heights, pressures and shear to single precision."""
    found, wanted = read_outputs(folder, ASKED), _outputs()
    assert found.simulator == SIMULATOR
    assert found.left_out == (2,)
    for index, press in wanted.presses.items():
        other = found.presses[index]
        np.testing.assert_array_equal(other.image, press.image)
        np.testing.assert_allclose(other.height_m, press.height_m, rtol=1e-6)
        np.testing.assert_allclose(other.pressure_pa, press.pressure_pa, rtol=1e-6)
        np.testing.assert_allclose(other.shear_pa, press.shear_pa, rtol=1e-6)
        assert (other.force_n, other.depth_m) == (press.force_n, None)


def test_units_count(folder: Path) -> None:
    """Millimetres and millinewtons are taken as such."""
    _replace(folder / "simulator.toml", 'height = "m"', 'height = "mm"')
    _replace(folder / "simulator.toml", 'force = "N"', 'force = "mN"')
    found, wanted = read_outputs(folder, ASKED), _outputs()
    np.testing.assert_allclose(
        found.presses[1].height_m, 1e-3 * wanted.presses[1].height_m, rtol=1e-6
    )
    assert found.presses[3].force_n == pytest.approx(1.5e-3)


def test_swapped_channels_are_read_as_said(folder: Path) -> None:
    """Images whose file has blue first are turned when the folder says so."""
    for index in (1, 3):
        cv2.imwrite(str(folder / f"{index:02d}/image.png"), _image(index))  # takes RGB for BGR
    _replace(folder / "simulator.toml", '"RGB"', '"BGR"')
    np.testing.assert_array_equal(read_outputs(folder, ASKED).presses[3].image, _image(3))


def test_forces_alone_will_do(tmp_path: Path) -> None:
    """A folder without images needs neither folders of presses nor a colour order."""
    (tmp_path / "simulator.toml").write_text(
        'name = "f"\nversion = "1"\ndriven_by = "force"\n[units]\nforce = "N"\ndepth = "mm"\n'
    )
    (tmp_path / "forces.csv").write_text("press,force,depth\n1,1,0.1\n2,2,0.2\n3,3,0.3\n")
    found = read_outputs(tmp_path, ASKED)
    assert found.presses[2].depth_m == pytest.approx(2e-4)
    assert found.presses[2].image is None


Damage = Callable[[Path], object]
TOML = "simulator.toml"


def _replace(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def _npy(array: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array, allow_pickle=True)
    return buffer.getvalue()


def _png(shape: tuple[int, ...], value: int = 7) -> bytes:
    return bytes(cv2.imencode(".png", np.full(shape, value, dtype=np.uint8))[1])


def _archive(folder: Path, **members: bytes) -> None:
    with zipfile.ZipFile(folder / "01/fields.npz", "w") as archive:
        for name, data in members.items():
            archive.writestr(f"{name}.npy", data)


class _Evil:
    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.mkdir, ("executed",)


def _put(name: str, data: bytes) -> Damage:
    return lambda folder: (folder / name).write_bytes(data)


def _toml(old: str, new: str) -> Damage:
    return lambda folder: _replace(folder / TOML, old, new)


def _csv(old: str, new: str) -> Damage:
    return lambda folder: _replace(folder / "forces.csv", old, new)


PLAIN = np.zeros((HEIGHT, WIDTH))
NAN = np.where(np.arange(WIDTH) == 5, np.nan, PLAIN)
DAMAGES: dict[str, tuple[Damage, str]] = {
    "no description": (lambda f: (f / TOML).unlink(), "simulator.toml"),
    "no TOML": (lambda f: (f / TOML).write_text("name = "), "not valid TOML"),
    "not text": (lambda f: (f / TOML).write_bytes(b"\xff\xfe"), "not valid TOML"),
    "no version": (_toml('version = "0.1"', ""), "version: missing"),
    "markup": (_toml("Other é", "<b>"), "name"),
    "unknown key": (_toml("note", "notes"), "unknown key"),
    "no time": (_toml("12.5", "-1"), "milliseconds_an_image"),
    "not a time": (_toml("12.5", "nan"), "milliseconds_an_image"),
    "no unit of heights": (_toml('height = "m"', ""), "units.height"),
    "no unit of forces": (_toml('force = "N"', ""), "units.force"),
    "wrong unit": (_toml('"Pa"', '"psi"'), "psi"),
    "what was told": (_toml('driven_by = "depth"', ""), "driven_by"),
    "no colour order": (_toml('colour_order = "RGB"', ""), "colour_order is not stated"),
    "channels exchanged": (
        _toml('colour_order = "RGB"', 'colour_order = "BGR"'),
        "red and blue exchanged",
    ),
    "a press is missing": (_toml("[2]", "[]"), "press 2 is missing"),
    "a press of no run": (lambda f: (f / "04").mkdir(), "none of the run"),
    "a press twice": (lambda f: (f / "1").mkdir(), "stands twice"),
    "left out and there": (lambda f: (f / "02").mkdir(), "left_out"),
    "an empty press": (lambda f: [path.unlink() for path in (f / "03").iterdir()], "holds none of"),
    "one image less": (lambda f: (f / "01/image.png").unlink(), "presses 1 have no image.png"),
    "wrong size": (_put("01/image.png", _png((HEIGHT, WIDTH + 1, 3))), "25 x 16 px"),
    "no image": (_put("01/image.png", b"no"), "no whole JPEG or PNG"),
    "cut image": (_put("01/image.png", _png((HEIGHT, WIDTH, 3))[:60]), "01/image.png"),
    "with alpha": (_put("01/image.png", _png((HEIGHT, WIDTH, 4))), "RGBA"),
    "pickle": (_put("01/height.npy", _npy(np.array([_Evil()], dtype=object))), "never loaded"),
    "words": (_put("01/height.npy", _npy(np.full((HEIGHT, WIDTH), "a"))), "not of numbers"),
    "other shape": (_put("01/height.npy", _npy(PLAIN.T)), r"\[24, 16\]"),
    "NaN": (_put("01/height.npy", _npy(NAN)), "row 0, column 5"),
    "no array": (_put("01/height.npy", b"no"), "no whole NumPy array"),
    "other fields": (lambda f: _archive(f, stress=_npy(PLAIN)), "stress"),
    "half a shear": (lambda f: _archive(f, shear_y=_npy(PLAIN)), "without the other"),
    "an empty archive": (_archive, "holds nothing"),
    "a link out": (
        lambda f: [(f / "01/image.png").unlink(), (f / "01/image.png").symlink_to("/dev/zero")],
        "leads out",
    ),
    "no number": (_csv("0.5", "much"), "line 2"),
    "a force that is NaN": (_csv("0.5", "nan"), "presses 1 have no"),
    "a press of no run's force": (_csv("3,", "7,"), 'press "7"'),
    "a force twice": (_csv("3,", "1,"), "stands twice"),
    "no column": (_csv("press", "trial"), "no column"),
    "one force less": (_csv("1,0.5,", "1,,"), "presses 1 have no"),
}


@pytest.mark.parametrize("name", DAMAGES)
def test_damage_is_refused_by_name(
    folder: Path, name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Whatever is wrong: the message names folder and thing, says what to do, nothing is run."""
    monkeypatch.chdir(tmp_path)
    damage, said = DAMAGES[name]
    damage(folder)
    with pytest.raises(RigError, match=said) as caught:
        read_outputs(folder, ASKED)
    assert str(folder) in caught.value.message
    assert caught.value.remedy
    assert not (tmp_path / "executed").exists()


def test_no_folder_is_named(tmp_path: Path) -> None:
    """A path that is none ends with it."""
    with pytest.raises(RigError, match="nowhere"):
        read_outputs(tmp_path / "nowhere", ASKED)


def test_old_presses_are_not_mixed_with_new_ones(folder: Path) -> None:
    """Nothing is written into a folder that holds something."""
    with pytest.raises(RigError, match="not empty"):
        write_outputs(folder, _outputs())


MEASURED = {1: (1.0, 0.3e-3), 2: (2.0, 0.5e-3), 3: (3.0, 0.7e-3)}
PIXEL_M2 = 4e-9


def _conventional(random: np.random.Generator) -> Outputs:
    """Return outputs of a fair simulator: forces, heights and pressures within a factor of two."""
    presses = {}
    for trial, (force, depth) in MEASURED.items():
        factor = random.uniform(0.5, 2.0)
        there = np.zeros((HEIGHT, WIDTH))
        there[4:8, 4:8] = 1.0
        presses[trial] = PressOutput(
            force_n=factor * force,
            height_m=-factor * depth * there,
            pressure_pa=factor * force / PIXEL_M2 / there.sum() * there,
        )
    return Outputs(simulator=SIMULATOR, presses=presses, left_out=())


@pytest.mark.parametrize(
    ("factors", "told"),
    [
        ({}, ""),
        ({"force_n": -1.0}, "signs.force = -1"),
        ({"force_n": 1e3}, "the numbers look like mN where N"),
        ({"force_n": 1e-3}, "units.force"),
        ({"height_m": -1.0}, "signs.height = -1"),
        ({"height_m": 1e-3}, "units.height of simulator.toml: the numbers look like m where mm"),
        ({"pressure_pa": -1.0}, "signs.pressure = -1"),
        ({"pressure_pa": 1e3}, "units.pressure"),
    ],
)
def test_a_convention_is_no_defeat(factors: dict[str, float], told: str, tmp_path: Path) -> None:
    """What is wrong by its sign or unit in every press is refused by the key that declares it."""
    outputs = _conventional(np.random.default_rng(len(told)))
    presses = {
        trial: replace(press, **{name: by * getattr(press, name) for name, by in factors.items()})
        for trial, press in outputs.presses.items()
    }
    write_outputs(tmp_path / "theirs", replace(outputs, presses=presses))
    asked = replace(ASKED, measured=MEASURED, pixel_m2=PIXEL_M2)
    if not told:
        assert len(read_outputs(tmp_path / "theirs", asked).presses) == len(MEASURED)
        return
    with pytest.raises(RigError) as refused:
        read_outputs(tmp_path / "theirs", asked)
    assert told in str(refused.value)


DEPTH_M, PLACE_M, DIAMETER_M = 0.5e-3, (1e-3, -0.5e-3), 8e-3


@pytest.mark.parametrize("dome_m", [np.inf, 60e-3])
def test_a_ball_cuts_a_cap(dome_m: float) -> None:
    """The deepest point is as deep as was asked, at its place, and a cap has the ball's edge."""
    pad = BoxPad(size_x_m=20e-3, size_y_m=16e-3, height_m=4e-3, dome_radius_x_m=dome_m)
    view = CameraGeometry.centred(161, 121, scale_x_m=0.1e-3, scale_y_m=0.1e-3)
    rest, loaded = rigid_heights(
        pad, Sphere(diameter_m=DIAMETER_M), view, depth_m=DEPTH_M, place_m=PLACE_M
    )
    cut = rest - loaded
    x, y = view.pad_grid()
    away = np.hypot(x - PLACE_M[0], y - PLACE_M[1])
    row, column = np.unravel_index(np.argmin(away), away.shape)
    assert cut[row, column] == pytest.approx(DEPTH_M)
    assert cut.min() == 0.0
    radius_m = 0.5 * DIAMETER_M
    edge_m = np.sqrt(radius_m**2 - (radius_m - DEPTH_M) ** 2)
    if np.isinf(dome_m):
        assert cut[row, column] == cut.max()
        assert away[cut > 0.0].max() == pytest.approx(edge_m, abs=view.scale_x_m)
