"""``tacauchy-rig calibrate`` on folders of rendered presses, and on tables of forces."""

import csv
import json
import re
from dataclasses import replace
from importlib import resources
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from sim.optics.calibrate import circle_and_light as pressed_scene
from sim.optics.colour.photometric import load_photometric
from sim.sensor.sensor import load_sensor
from tacauchy_rig.app.cli.app import app
from tacauchy_rig.core.errors import ConfigError, RecordError
from tests.sim.optics.rendered_targets import photograph, printed_dots
from tests.sim.optics.synthetic_presses import PROFILE, press_scene, presses
from tests.tacauchy_rig.app.calibration.material.made_up import SURE, made_presses, made_response

HEADER = ["image", "center_x_px", "center_y_px", "radius_px"]
OPTIONS = ["--ball-diameter", "4.70mm", "--scale", "10px/mm", "--background", "no_contact.png"]
OPTIONS += ["--jobs", "1"]  # processes take seconds to start


@pytest.fixture(autouse=True)
def known_gel(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take the gel that the presses were rendered with in place of a simulated one."""
    monkeypatch.setattr(pressed_scene, "ball_profiles", lambda *_, **__: PROFILE)


def _folder(folder: Path, *, count: int = 14, seed: int = 0, table: bool = True) -> Path:
    folder.mkdir()
    labelled = presses(count, noise=1.5, click_px=1.0, light=4.0, seed=seed)[0]
    for press in labelled:
        cv2.imwrite(str(folder / press.name), press.image[..., ::-1])
    cv2.imwrite(
        str(folder / "no_contact.png"), press_scene().background[..., ::-1].astype(np.uint8)
    )
    if table:
        with (folder / "circles.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(HEADER)
            for p in labelled:
                writer.writerow([p.name, p.circle.x_px, p.circle.y_px, p.circle.radius_px])
    return folder


def _run(*words: object) -> str:
    result = CliRunner().invoke(app, ["calibrate", *map(str, words)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


@pytest.mark.slow
def test_folder_becomes_a_calibration(tmp_path: Path) -> None:
    """The file renders, the scores are those of noise, and --check agrees with them."""
    folder = _folder(tmp_path / "presses", count=9)
    others = _folder(tmp_path / "others", count=5, seed=7)
    out, scores = tmp_path / "made" / "calibration.npz", tmp_path / "scores.json"
    printed = _run(
        "optics", folder, *OPTIONS, "--circles", "circles.csv", "--check", others,
        "--out", out, "--json", scores, "--folds", 3,
    )  # fmt: skip
    found = json.loads(scores.read_text("utf-8"))
    for part, count in (("cross_validation", 9), ("check", 5)):
        assert found[part]["press_count"] == count
        assert found[part]["r2"] > 0.97
        assert found[part]["mae"] < 2.5
        assert found[part]["ssim_crop"] > found[part]["ssim_crop_no_contact"] + 0.03
        assert found[part]["mae"] < 0.4 * found[part]["mae_no_contact"]
    assert len(found["presses"]) == 9
    model = load_photometric(out)
    assert model.provenance["ball_diameter_m"] == pytest.approx(4.7e-3)
    assert len(str(model.provenance["presses_sha256"])) == 64
    assert "cross-validated: 9 presses" in printed
    for name in ("calibration_slopes.png", "calibration_held_out.png"):
        assert (cv2.imread(str(out.with_name(name))) < 250).any()


@pytest.mark.slow
def test_contacts_are_found_without_a_table(tmp_path: Path) -> None:
    """Without circles the contacts are found, the scores hardly suffer, and judge has images."""
    folder = _folder(tmp_path / "presses", count=6, table=False)
    scores, shown = tmp_path / "scores.json", tmp_path / "shown"
    made = ["--out", tmp_path / "c.npz", "--json", scores, "--outputs", shown]
    _run("optics", folder, *OPTIONS, *made, "--folds", 2)
    found = json.loads(scores.read_text("utf-8"))
    assert found["cross_validation"]["r2"] > 0.95
    assert any("only 6 presses" in warning for warning in found["warnings"])
    unloaded = cv2.imread(str(folder / "no_contact.png")).astype(np.float64)
    names = sorted(path.name for path in folder.glob("*.png") if path.name != "no_contact.png")
    for number, name in enumerate(names, start=1):
        real = cv2.imread(str(folder / name))
        image = cv2.imread(str(shown / f"{number:02d}/image.png"))
        assert np.abs(image - real.astype(np.float64)).mean() < np.abs(unloaded - real).mean()
    with pytest.raises(RecordError, match="not empty"):
        _run("optics", folder, *OPTIONS, *made, "--folds", 2)


def test_scale_from_a_target(tmp_path: Path) -> None:
    """Dots give mm per pixel; the numbers are printed and written."""
    geometry = press_scene().geometry
    printed = printed_dots(columns=7, rows=5, pitch_m=2e-3, radius_m=5e-4)
    image = photograph(printed, geometry, blur_px=0.5, noise=1.0)
    cv2.imwrite(str(tmp_path / "dots.png"), image)
    out = tmp_path / "scale.json"
    words = ["--target", "dots:columns=7,rows=5,pitch=2mm", "--json", out]
    assert "35 of 35 points" in _run("scale", tmp_path / "dots.png", *words)
    found = json.loads(out.read_text("utf-8"))
    assert found["scale_x_m_px"] == pytest.approx(1e-4, rel=2e-3)
    assert found["centre_x_px"] == pytest.approx(89.5, abs=0.1)


def test_a_raw_image_of_a_target_is_brought_to_the_sensors_size(tmp_path: Path) -> None:
    """A tenth cut off at each border, then half as many pixels: the scored pixel's scale."""
    sensor = load_sensor("digit").camera
    scored = replace(sensor, width=64, height=48, scale_x_m=2e-4, scale_y_m=2e-4)
    raw = replace(
        scored,
        width=160,
        height=120,
        scale_x_m=1e-4,
        scale_y_m=1e-4,
        centre_x_px=79.5,
        centre_y_px=59.5,
    )
    dots = printed_dots(columns=5, rows=4, pitch_m=2e-3, radius_m=0.6e-3)
    cv2.imwrite(str(tmp_path / "raw.png"), photograph(dots, raw, blur_px=0.5, noise=1.0))
    text = resources.files("sim.sensor.files").joinpath("digit.toml").read_text("utf-8")
    text = re.sub("width = .*", "width = 64", re.sub("height = 2.*", "height = 48", text))
    (tmp_path / "small.toml").write_text(re.sub("crop = .*", "crop = 0.1", text), encoding="utf-8")
    words = ["--target", "dots:columns=5,rows=4,pitch=2mm", "--json", tmp_path / "scale.json"]
    printed = _run("scale", tmp_path / "raw.png", *words, "--sensor", tmp_path / "small.toml")
    assert "64 x 48 px" in printed
    found = json.loads((tmp_path / "scale.json").read_text("utf-8"))
    assert found["scale_x_m_px"] == pytest.approx(2e-4, rel=5e-3)


@pytest.mark.parametrize("dome", [(), ("--sensor", "digit", "--ball-diameter", "4mm")])
def test_scale_from_presses(tmp_path: Path, dome: tuple[str, ...]) -> None:
    """Circles and places give the scale to the clicks' error; a dome of 100 mm shifts contacts."""
    folder = _folder(tmp_path / "presses")
    reach_m = 1e-4 * (1.02 if dome else 1.0)
    with (folder / "circles.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    places = [
        (row["image"], *(reach_m * (float(row[HEADER[k]]) - c) for k, c in ((1, 89.5), (2, 74.5))))
        for row in rows
    ]
    lines = ["image,x_m,y_m", *(f"{name},{x:.7f},{y:.7f}" for name, x, y in places)]
    (folder / "positions.csv").write_text("\n".join(lines), encoding="utf-8")
    out = tmp_path / "scale.json"
    assert "14 presses" in _run("scale", "--presses", folder, *dome, "--json", out)
    found = json.loads(out.read_text("utf-8"))
    assert found["scale_y_m_px"] == pytest.approx(1e-4, rel=1e-3)
    # the dome's radius is stated to 20 %: 0.2 * 2 / 102 of the scale
    assert found["scale_error_m_px"][1] == pytest.approx(1e-4 * (4e-3 if dome else 0.0), abs=6e-8)


def _refused(*words: object) -> ConfigError:
    with pytest.raises(ConfigError) as caught:
        CliRunner().invoke(app, ["calibrate", *map(str, words)], catch_exceptions=False)
    return caught.value


def test_refusals(tmp_path: Path) -> None:
    """Too few presses, a ball too small for its circles, no scale, a wrong ending."""
    few = _folder(tmp_path / "few", count=3)
    out = ["--out", tmp_path / "c.npz"]
    assert "3 ball presses are too few" in _refused("optics", few, *OPTIONS, *out).message
    folder = _folder(tmp_path / "presses", count=6)
    for size in ("2mm", "90m"):  # such a large one would not sink in
        message = _refused("optics", folder, *OPTIONS[:1], size, *OPTIONS[2:], *out).message
        assert "cannot be of a ball of diameter" in message
    flat = [*OPTIONS[:3], "0px/mm", *OPTIONS[4:]]
    assert "not positive" in _refused("optics", folder, *flat, *out).message
    assert "no .npz" in _refused("optics", folder, *OPTIONS, "--out", tmp_path / "c.txt").message
    assert "needs an image with --target" in _refused("scale").message
    domed = _refused("scale", "--presses", tmp_path, "--sensor", "digit")
    assert "needs both --sensor and --ball-diameter" in domed.message


def _never(*_: object, **__: object) -> None:
    raise AssertionError("simulated before the input was looked at")


def test_bad_input_is_refused_before_anything_is_simulated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Images, tables and folders are looked at first, those of --check too."""
    monkeypatch.setattr(pressed_scene, "ball_profiles", _never)
    out = ["--out", tmp_path / "c.npz"]
    missing, empty = tmp_path / "nowhere", tmp_path / "empty"
    empty.mkdir()
    folder = _folder(tmp_path / "presses", count=6)
    for presses_folder, words, told in (
        (missing, [], f"{missing} is no folder"),
        (folder, ["--circles", "nope.csv"], "circle table nope.csv cannot be read"),
        (folder, ["--check", missing], f"{missing} is no folder"),
        (folder, ["--check", empty], "empty holds no image"),
    ):
        assert told in _refused("optics", presses_folder, *OPTIONS, *out, *words).message
    first = sorted(folder.glob("0*.png"))[0]
    whole = first.read_bytes()
    cv2.imwrite(str(first), np.zeros((75, 90, 3), np.uint8))
    message = _refused("optics", folder, *OPTIONS, *out).message
    assert f"{first.name} is 90 x 75 px, the no-contact frame 180 x 150 px" in message
    first.write_bytes(whole)
    table = (folder / "circles.csv").read_text("utf-8").splitlines()
    table[1] = f"{first.name},1000,75,15"
    (folder / "circles.csv").write_text("\n".join(table), encoding="utf-8")
    message = _refused("optics", folder, *OPTIONS, *out).message
    assert f"{first.name}: its circle is around column 1000, row 75" in message


@pytest.mark.slow
def test_figures_of_an_earlier_calibration_are_no_presses(tmp_path: Path) -> None:
    """Written into the folder of the presses, a calibration can be made again."""
    folder = _folder(tmp_path / "presses", count=5, table=False)
    earlier = [folder / "c_slopes.png", folder / "c_held_out.png"]
    for path in earlier:
        path.write_bytes(next(folder.glob("0*.png")).read_bytes())
    taken = earlier[0].read_bytes()
    _run("optics", folder, *OPTIONS, "--out", folder / "c.npz", "--folds", 2)
    assert all(path.read_bytes() != taken for path in earlier)
    assert len(list(folder.glob("*.png"))) == 5 + len(["no_contact.png", *earlier])


@pytest.mark.slow
def test_contradictory_presses_are_refused(tmp_path: Path) -> None:
    """Circles that belong to other images cannot be learnt from."""
    folder = _folder(tmp_path / "presses", count=8)
    rng = np.random.default_rng(0)
    lines = (folder / "circles.csv").read_text("utf-8").splitlines()
    moved = [f"{line.split(',')[0]},{x},{y},12" for line, (x, y) in
             zip(lines[1:], rng.uniform(20, 130, (8, 2)), strict=True)]  # fmt: skip
    (folder / "circles.csv").write_text("\n".join([lines[0], *moved]), encoding="utf-8")
    words = [*OPTIONS, "--folds", 2, "--out", tmp_path / "c.npz"]
    message = _refused("optics", folder, *words).message
    assert "of 8 labels contradict their images: 0000.png was left out" in message


BALL = {"power": 1.5, "confined": 2.0}
GEL = {"young_pa": 5e5, "poisson": 0.465, "friction": 0.4}


@pytest.mark.parametrize("wrong", [False, True])
def test_one_ball_from_a_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, wrong: bool
) -> None:
    """Modulus and stated nu predict the forces; of wrong ones nothing is written."""
    monkeypatch.setattr(
        "tacauchy_rig.app.calibration.material.fit_and_next_presses.respond",
        lambda *_, **__: made_response(**BALL),
    )
    candidates = ("sphere:diameter=6mm", "sphere:diameter=10mm")
    monkeypatch.setattr(
        "tacauchy_rig.app.calibration.material.fit_and_next_presses.CANDIDATES", candidates
    )
    presses = made_presses("sphere:diameter=6mm", **GEL, **BALL)
    force_n = presses.force_n.copy()
    force_n[4] *= 1.2 if wrong else 1.0
    table = tmp_path / "presses.csv"
    rows = zip(presses.depth_m, force_n, strict=True)
    lines = [f"sphere:diameter=6mm,{depth * 1e3},{force}" for depth, force in rows]
    table.write_text("\n".join(["indenter,depth_mm,force_n", *lines]) + "\n")
    out, found = tmp_path / "my.toml", tmp_path / "found.json"
    options = ["--out", str(out), "--json", str(found)]
    for override in SURE:
        options += ["--set", override]
    options += ["--sensor", "gelsight-mini", "--noise", "5mN"]
    result = CliRunner().invoke(app, ["calibrate", "material", str(table), *options])
    told = json.loads(found.read_text())
    assert told["told"]["poisson"]["low"] is None
    assert len(told["left_out"]) == 8
    assert "Poisson's ratio nu  not determined by these presses" in result.output
    assert result.exit_code == int(wrong), result.output
    assert out.exists() != wrong
    if wrong:
        assert "sphere:diameter=6mm at 0.5 mm: " in result.output
        return
    assert "next: sphere:diameter=10mm to 0.8 mm, for " in result.output
    assert "next: sphere:diameter=6mm" not in result.output
    assert "with nu 0.48 +- 0.01 and mu 0.5 +- 0.2 as stated, E is " in result.output
    assert "relaxation: unknown, a table has no times" in result.output
    made = load_sensor(str(out))
    # At nu 0.48 in place of 0.465 the formula's ball is 3 % stiffer, so that E is as much smaller.
    assert made.material.young_pa == pytest.approx(5e5 * 0.97, rel=0.03)
    assert made.material.poisson == 0.48
