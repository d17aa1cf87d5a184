"""Recordings as labs write them: each kind ends with the right forces, or is refused by name."""

import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

from tacauchy_rig.app.importing.image_conversion import opened
from tacauchy_rig.app.importing.importer import import_run
from tacauchy_rig.core.errors import RecordError, RigError
from tacauchy_rig.core.store.check.run_and_press_check import check_run
from tests.tacauchy_rig.app.importing.sources import counting

SEED = 20261127
SIZE = (480, 360)  # of an image [px]
PER_GF = 1.0 / 9.80665e-3
BALL = "sphere:diameter=8mm"
SPEC = """
kind = "csv"
{top}
[data]
table = "presses.csv"
no_contact = "rest.png"
is_tared = {tared}
{data}
[data.columns]
image = "file"
force = {{ column = "fz", unit = "{force}"{force_sign} }}
depth = {{ column = "d", unit = "{depth}" }}
{columns}
[rig.sensor]
name = "gelsight-mini"
[rig.replay]
{body}
{rig}
"""
TURNED = "[rig.force_sensor]\ncompression_sign = -1"


@dataclass(slots=True)
class Folder:
    """A folder of presses before it is written."""

    root: Path
    random: np.random.Generator
    force_n: np.ndarray  # of each press
    depth_mm: np.ndarray  # that this gel has at those forces, roughly
    rows: list[list[str]] = field(default_factory=list)  # head line and cells
    separator: str = ","
    spec: dict[str, str] = field(default_factory=dict)
    # What a refusal has to say, each of it; empty where forces have to come out.
    told: Sequence[str] = ()
    noted: str = ""  # what the import has to say of it besides
    prefix: bytes = b""
    tolerance_n: float = 1e-9

    def write(self) -> None:
        """Write all of it."""
        known = dict.fromkeys(("top", "data", "columns", "force_sign", "rig"), "")
        known |= {"tared": "true", "force": "N", "depth": "mm", "body": f'indenter = "{BALL}"'}
        (self.root / "import.toml").write_text(SPEC.format(**known | self.spec))
        text = "\n".join(self.separator.join(row) for row in self.rows) + "\n"
        (self.root / "presses.csv").write_bytes(self.prefix + text.encode())


def drawn(root: Path) -> Folder:
    """Return presses of a ball with images, not yet written."""
    random = np.random.default_rng([SEED, 0])
    force = np.round(random.uniform(0.5, 4.0, random.integers(3, 6)), 3)
    depth = np.round(0.27 * force ** (2 / 3) * random.uniform(0.8, 1.2), 4)
    rows = [["file", "fz", "d"]]
    folder = Folder(root=root, random=random, force_n=force, depth_mm=depth, rows=rows)
    (root / "rest.png").write_bytes(image(random, 0.0))
    for k, (f, d) in enumerate(zip(force.tolist(), depth.tolist(), strict=True), start=1):
        (root / f"p{k}.png").write_bytes(image(random, d))
        folder.rows.append([f"p{k}.png", f"{f}", f"{d}"])
    return folder


def image(
    random: np.random.Generator,
    depth_mm: float,
    *,
    kind: str = ".png",
    size: tuple[int, int] = SIZE,
    at: tuple[float, float] = (0.5, 0.375),
) -> bytes:
    """Return an image with a gradient of light, noise, and something pressed [widths]."""
    y, x = np.mgrid[0 : size[1], 0 : size[0]] / max(size)
    inside = np.hypot(x - at[0], y - at[1]) < 0.1 * depth_mm**0.5
    level = 80.0 + 60.0 * x + 30.0 * y + 40.0 * inside + random.normal(0.0, 2.0, x.shape)
    colour = np.clip(np.stack([level, 0.8 * level, 0.6 * level], axis=-1), 0, 255)
    return bytes(cv2.imencode(kind, colour.astype(np.uint8))[1])


def _cells(folder: Folder, column: int, of: Callable[[float], str]) -> None:
    for row in folder.rows[1:]:
        row[column] = of(float(row[column]))


def _scaled(column: int, factor: float, *told: str, **spec: str) -> Callable[[Folder], None]:
    def change(folder: Folder) -> None:
        _cells(folder, column, lambda v: repr(v * factor))
        folder.spec |= spec
        folder.told = told

    return change


def _placed(noted: str, *, down: float = 1.0, unit: float = 1.0) -> Callable[[Folder], None]:
    """Return what writes presses of 1 N at five places into images, and what is noted of them."""

    def change(folder: Folder) -> None:
        folder.noted, head = noted, ["file", "fz", "d", "x", "y"]
        folder.rows, folder.force_n = [head], np.ones(5)
        columns = [f'{each} = {{ column = "{each}", unit = "mm" }}' for each in "xy"]
        folder.spec["columns"] = "\n".join(columns)
        places = ((-3.0, -2.0), (3.0, -1.5), (2.0, 2.5), (-2.0, 1.0), (0.5, 0.0))
        for k, (x, y) in enumerate(places):
            # 320 columns of 0.0634 mm are 0.7 of a whole frame.
            at = (0.5 + x * 0.7 / 20.3, 0.375 + down * y * 0.7 / 20.3)
            (folder.root / f"at{k}.png").write_bytes(image(folder.random, 0.4, at=at))
            folder.rows.append([f"at{k}.png", "1.0", "0.3", repr(unit * x), repr(unit * y)])

    return change


def kilograms_force(folder: Folder) -> None:
    """Kilograms-force where newtons are stated."""
    _cells(folder, 1, lambda v: repr(v / 9.80665))
    folder.force_n, folder.noted = folder.force_n / 9.80665, "kgf where N is stated"


def _again(folder: Folder, *, size: tuple[int, int], told: Sequence[str] = ()) -> None:
    folder.told = told
    for name in ("rest.png", *(row[0] for row in folder.rows[1:])):
        (folder.root / name).write_bytes(image(folder.random, 0.4, size=size))


def _labelled(folder: Folder, time: Callable[[int], str], *, after: bool = False) -> None:
    zero = folder.random.uniform(-0.5, 0.5)
    rows, old = [["file", "fz", "d", "t", "n", "s"]], folder.rows[1:]
    for n, (name, f, d) in enumerate(old, start=1):
        states = ["rest"] * 3 + ["press"] * 3 + ["rest"] * (2 if after else 0)
        for state in states:
            held = state == "press"
            felt = repr(zero + (float(f) if held else 0.0))
            told = [time(len(rows) - 1), str(n), state]
            rows.append([name if held else "rest.png", felt, d if held else "", *told])
    folder.rows = rows
    folder.tolerance_n = 1e-6
    folder.spec["tared"] = "false"
    folder.spec["data"] = 'unloaded = "rest"\npressed = "press"'
    folder.spec["columns"] = 'time = { column = "t", unit = "s" }\npress = "n"\nstate = "s"\n'


def _odd(noted: str, felt: Callable[[float, int], float], step_s: float = 0.04) -> Any:
    """Return what changes forces of rows at rest and pressed, by their number."""

    def change(folder: Folder) -> None:
        _labelled(folder, lambda k: repr(k * step_s))
        for k, row in enumerate(folder.rows[1:]):
            row[1] = repr(felt(float(row[1]), k))
        folder.noted = noted

    return change


SCALED = {
    "images on their side": partial(_again, size=(360, 480), told=("a quarter", "images.turn")),
    "images of another aspect ratio": partial(_again, size=(640, 360), told=("ratio", "1.778")),
    "places as they are seen": _placed(""),
    "places upside down": _placed("mirrored top to bottom and turned by 0 degrees", down=-1.0),
    "centimetres for millimetres": _placed("times as far apart as the stated", unit=0.1),
    "times too coarse": partial(_labelled, time=lambda k: f"{1790000000 + 128 * (k // 12)}.0"),
    "at rest after presses too": partial(_labelled, time=lambda k: f"{k * 0.04:.3f}", after=True),
    "milliseconds for seconds": _odd("if it took a thousandth", lambda n, k: n + 0.0 * k, 250.0),
    "a force is no number": _odd("'nan' is no force; 1 of", lambda n, k: n if k != 3 else np.nan),
    "the zero drifts": _odd("the force at rest moves by 0.7 N", lambda n, k: n + 0.7 * (k // 6)),
    "millinewtons for newtons": _scaled(1, 1e3, "look like mN where N", "data.columns.force.unit"),
    "grams-force for newtons": _scaled(1, PER_GF, "gf where N", "data.columns.force.unit"),
    "grams, which are a mass": _scaled(1, PER_GF, "data.columns.force.unit", "gf", force="g"),
    "compression is negative": _scaled(1, -1.0, "forces are negative", "compression_sign = -1"),
    "and it is not": _scaled(1, 1.0, "forces are negative", "compression_sign = 1", rig=TURNED),
    "and it is said": _scaled(1, -1.0, force_sign=", sign = -1"),
    "depths are negative": _scaled(2, -1.0, "depths are negative", "data.columns.depth.sign = -1"),
    "metres for millimetres": _scaled(2, 1e-3, "um deep", "m where mm", "data.columns.depth.unit"),
    "um for mm": _scaled(2, 1e3, "the gel is 4 mm high", "um where mm", "data.columns.depth.unit"),
}
"""A column in another unit or sign than is stated, and what is told of it."""


def comma(value: float, digits: int = 4) -> str:
    """Return a number with a decimal comma."""
    return f"{value:.{digits}f}".replace(".", ",")


def spreadsheet(folder: Folder) -> None:
    """Semicolons, decimal commas and a byte order mark."""
    folder.separator = ";"
    folder.prefix = b"\xef\xbb\xbf" if folder.random.random() < 0.7 else b""
    for column in (1, 2):
        _cells(folder, column, comma)


def tabs(folder: Folder) -> None:
    """Tabs, with a comma or a point for decimals."""
    folder.separator = "\t"
    if folder.random.random() < 0.5:
        _cells(folder, 1, comma)


def quoted(folder: Folder) -> None:
    """Every cell in quotation marks, decimal commas between commas."""
    for column in (1, 2):
        _cells(folder, column, lambda v: comma(v, 2))
    folder.rows = [[f'"{cell}"' for cell in row] for row in folder.rows]
    folder.tolerance_n = 0.0051


def blank_lines(folder: Folder) -> None:
    """Blank lines and a word: the line that is told is that of the file."""
    bad = int(folder.random.integers(2, len(folder.rows)))
    folder.rows[bad][1] = "oops"
    blank = int(folder.random.integers(1, 5))
    folder.rows[2:2] = [[""]] * blank
    folder.told = (f"line {bad + 1 + blank}", '"fz"', "'oops'")


def several(folder: Folder) -> None:
    """Several things are wrong, and all are told."""
    folder.rows[1][1], folder.rows[2][2], folder.rows[3][0] = "1_5", "deep", "no.png"
    folder.told = ("'1_5'", "'deep'", "no.png", "line 2", "line 3", "line 4")


def backslashes(folder: Folder) -> None:
    """Names of another system, in a folder; files of another system beside them."""
    (folder.root / "images").mkdir()
    for row in folder.rows[1:]:
        (folder.root / row[0]).rename(folder.root / "images" / row[0])
        (folder.root / "images" / f"._{row[0]}").write_bytes(b"\0\5\x16\7")
        row[0] = f"images\\{row[0]}"


def unknown_first(folder: Folder) -> None:
    """The first depth is not known."""
    folder.rows[1][2] = ("nan", "NaN", "", "N/A")[folder.random.integers(4)]
    folder.noted = f"The depth of 1 of {len(folder.rows) - 1} presses (1) is not known."


def blind(folder: Folder) -> None:
    """No press has an image."""
    for row in folder.rows[1:]:
        row[0] = ""
    folder.noted = "The image of a press is not known."


def frozen(folder: Folder) -> None:
    """The camera stood still: every press has the image of the first."""
    for row in folder.rows[2:]:
        row[0] = "p1.png"
    told = f"{len(folder.rows) - 2} of {len(folder.rows) - 1} presses have the same image as an"
    folder.noted = f"{told} earlier one, press 2 that of 1"


def one_missing(folder: Folder) -> None:
    """The second of the lab's presses is not there: the run counts on, and says so."""
    folder.spec["columns"] = 'press = "n"'
    for name, row in zip(("n", "1", *map(str, range(3, 99))), folder.rows, strict=False):
        row.append(name)
    folder.noted = f"numbers {len(folder.rows) - 2} presses otherwise: trial 2 is its press 3"


def cut_short(folder: Folder) -> None:
    """The table lacks its last press, of which an image is there."""
    folder.force_n = folder.force_n[:-1]
    folder.noted = f"1 images are in no row of presses.csv, the first {folder.rows.pop()[0]}"


def bodiless(folder: Folder) -> None:
    """Nobody says what was pressed into what."""
    folder.spec["body"] = ""
    folder.noted = "The indenter is not known: cylinder:diameter=5mm,fillet=0.1mm is assumed"


def deep_pixels(folder: Folder) -> None:
    """Of 16 bits a channel, of which 8 are used: all would be black."""
    level = cv2.imread(str(folder.root / "p1.png")).astype(np.uint16)
    (folder.root / "p1.png").write_bytes(cv2.imencode(".png", level)[1])
    folder.told = ("p1.png", "RGB of 16 bits", "8 bits a channel")


def nanoseconds(folder: Folder) -> None:
    """Nanoseconds where seconds are stated."""
    _labelled(folder, lambda k: str(1790000000000000000 + 40000000 * k))
    folder.told = ('column "t"', "years", "ns where s is stated", "data.columns.time.unit")


def one_negative(folder: Folder) -> None:
    """One press pulls: it is named, not the convention."""
    k = int(folder.random.integers(1, len(folder.rows)))
    folder.rows[k][1] = "-" + folder.rows[k][1]
    folder.told = (f"line {k + 1}", "correct these presses")


def one_tenfold(folder: Folder) -> None:
    """One press has another force than its depth and the other presses say."""
    folder.force_n[1] *= 10.0
    folder.rows[2][1] = repr(float(folder.force_n[1]))
    folder.noted = "unlike those of other presses: presses.csv line 3"


def other_camera(folder: Folder) -> None:
    """The image at rest is of another camera."""
    still = cv2.imread(str(folder.root / "rest.png"))
    cv2.imwrite(str(folder.root / "rest.png"), still[:, ::-1])
    folder.noted = "grey levels from those at rest beside contacts"


def exif(folder: Folder) -> None:
    """Presses with a tag of a telephone's turn, and an image at rest without."""
    for row in folder.rows[1:]:
        path, tag = folder.root / row[0], Image.Exif()
        tag[0x0112] = int(folder.random.choice([3, 6, 8]))
        row[0] = row[0].replace(".png", ".jpg")
        Image.open(path).save(folder.root / row[0], "JPEG", exif=tag, quality=95)


def small_images(folder: Folder) -> None:
    """Images of 320 x 240 px are taken, as whole frames or as cropped."""
    _again(folder, size=(320, 240))
    folder.spec["data"] = ""
    folder.spec["top"] = "images = { cropped = true }" * (folder.random.random() < 0.5)


def damaged(folder: Folder) -> None:
    """A JPEG with bytes lost in its middle, or without its end."""
    name = f"p{folder.random.integers(1, len(folder.rows))}"
    data = bytearray(image(folder.random, 0.4, kind=".jpg"))
    at = int(folder.random.integers(len(data) // 3, 2 * len(data) // 3))
    data[at:] = b"" if folder.random.random() < 0.5 else bytes(200) + data[at + 200 :]
    (folder.root / f"{name}.jpg").write_bytes(bytes(data))
    folder.rows[int(name[1:])][0] = f"{name}.jpg"
    folder.told = (f"{name}.jpg", "no whole JPEG")


def rest_is_press(folder: Folder) -> None:
    """The image at rest is that of a press."""
    (folder.root / "rest.png").write_bytes((folder.root / "p2.png").read_bytes())
    folder.told = ("p2.png", "byte for byte")


def own_words(folder: Folder) -> None:
    """Indenters by words of the lab; one has no term."""
    for row, word in zip(folder.rows, ("tool", "ball8", "zyl5", *["ball8"] * 9), strict=False):
        row.append(word)
    folder.spec["columns"] = 'indenter = "tool"\n[data.indenters]\nball8 = "sphere:diameter=8mm"'
    folder.told = ("line 3", '"tool"', "'zyl5'", "[data.indenters]")


KINDS: dict[str, Callable[[Folder], None]] = SCALED | {
    name: each
    for name, each in tuple(globals().items())
    if getattr(each, "__annotations__", None) == {"folder": Folder, "return": None}
}
"""Every function above that changes a folder and needs no more than that."""


@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_ends_as_it_has_to(kind: str, tmp_path: Path) -> None:
    """With the forces that were written and a run that agrees with itself, or refused by name."""
    (root := tmp_path / "source").mkdir()
    folder = drawn(root)
    KINDS[kind](folder)
    folder.write()
    if folder.told:
        with pytest.raises(RigError) as refused:
            import_run(root, parent=tmp_path / "runs")
        assert not [each for each in folder.told if each not in str(refused.value)]
        return
    store = import_run(root, parent=tmp_path / "runs")
    assert list(check_run(store).missed()) == []
    imported, forces = store.imported.load(), [each.force_measured_n for each in counting(store)]
    assert folder.noted in " ".join([*imported.unknown, *imported.notes])
    assert folder.noted or not re.search("check|correct|were lost", " ".join(imported.notes))
    assert forces == pytest.approx(folder.force_n.tolist(), abs=folder.tolerance_n)


def test_progress_while_an_image_is_decoded_is_no_damage(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Another thread says on standard error how far it is: it is passed on."""
    whole = image(np.random.default_rng(SEED), 0.4, kind=".jpg")
    decode = cv2.imdecode

    def slow(*given: Any) -> Any:
        os.write(2, b"  2 s: importing\n")
        return decode(*given)

    monkeypatch.setattr(cv2, "imdecode", slow)
    assert opened(whole, name="whole")[0] == SIZE
    assert capfd.readouterr().err == "  2 s: importing\n"
    harmed = whole[: len(whole) // 2] + whole[len(whole) // 2 + 40 :]
    with pytest.raises(RecordError, match=r"harmed: no whole JPEG .*Corrupt JPEG data"):
        opened(harmed, name="harmed")
