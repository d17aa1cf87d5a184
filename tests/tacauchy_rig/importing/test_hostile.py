"""Damaged, hostile and half-empty sources each end with a message that names what is wrong."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import pytest

from tacauchy_rig.errors import RigError
from tacauchy_rig.importing.importer import import_run

ROWS = "image,fz,depth\npress.png,{},0.25\n"


def _toml(old: str, new: str) -> Callable[[Path], None]:
    def harm(folder: Path) -> None:
        path = folder / "import.toml"
        assert old in path.read_text()
        path.write_text(path.read_text().replace(old, new))

    return harm


def _rows(text: str) -> Callable[[Path], None]:
    return lambda folder: (folder / "presses.csv").write_text(text) and None


def _bytes(name: str, data: bytes) -> Callable[[Path], None]:
    return lambda folder: (folder / name).write_bytes(data) and None


def _link_out(folder: Path) -> None:
    outside = folder.parent / "secret.png"
    outside.write_bytes((folder / "press.png").read_bytes())
    (folder / "press.png").unlink()
    (folder / "press.png").symlink_to(outside)


def _pipe(folder: Path) -> None:
    (folder / "press.png").unlink()
    os.mkfifo(folder / "press.png")


def _vast_png(folder: Path) -> None:
    """A PNG of 60 bytes that claims 100,000 x 100,000 px."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    head = struct.pack(">IIBBBBB", 100_000, 100_000, 8, 2, 0, 0, 0)
    data = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", b"") + chunk(b"IEND", b"")
    (folder / "press.png").write_bytes(data)


def _cut_png(folder: Path) -> None:
    data = (folder / "press.png").read_bytes()
    (folder / "press.png").write_bytes(data[: len(data) // 2])


CASES: dict[str, tuple[Callable[[Path], None], str]] = {
    "no description": (lambda f: (f / "import.toml").unlink(), "import.toml"),
    "no TOML": (_toml('kind = "csv"', "kind = "), "not valid TOML"),
    "unknown kind": (_toml('"csv"', '"pickle"'), "kind"),
    "unknown key": (_toml("no_contact", "nocontact"), "data.nocontact"),
    "a unit of another dimension": (_toml('unit = "N"', 'unit = "mm"'), "data.columns.force.unit"),
    "no unit": (_toml(', unit = "N"', ""), "data.columns.force.unit"),
    "a table for devices": (
        _toml("[rig.sensor]", "[rig.limits]\nhard_force='1 kN'\n[rig.sensor]"),
        "rig",
    ),
    "a name with a path": (_toml("[data]", 'name = "../../x"\n[data]'), "name"),
    "the CSV is elsewhere": (_toml("[data]", '[data]\ntable = "/etc/passwd"'), "data.table"),
    "the CSV is above": (_toml("[data]", '[data]\ntable = "../x.csv"'), "leads out of the folder"),
    "images are above": (_toml("[data]", '[data]\nimages = ".."'), "leads out of the folder"),
    "a calibration elsewhere": (
        _toml("[rig.sensor]", '[rig.sensor]\noptics_calibration = "/etc/hostname"'),
        "rig.sensor.optics_calibration",
    ),
    "a tool elsewhere": (_toml("sphere:diameter=4mm", "mesh:/etc/hostname"), "rig.replay.indenter"),
    "no such sensor": (_toml("gelsight-mini", "gelsight-maxi"), "rig.sensor.name"),
    "a column that is not there": (_toml('column = "fz"', 'column = "f"'), "data.columns.force"),
    "an image above": (_rows("image,fz,depth\n../press.png,1,1\n"), "leads out of the folder"),
    "an image that is a link out": (_link_out, "leads out of the folder"),
    "an image that is a pipe": (_pipe, "no plain file"),
    "an image that is missing": (_rows("image,fz,depth\nno.png,1,1\n"), "no.png"),
    "an image that is empty": (_bytes("press.png", b""), "0 bytes"),
    "an image that is a script": (_bytes("press.png", b"#!/bin/sh\ntouch x\n"), "no whole JPEG"),
    "an image that is cut off": (_cut_png, "press.png"),
    "an image that claims to be vast": (_vast_png, "decompression bomb"),
    "no row": (_rows("image,fz,depth\n"), "no row below its head line"),
    "a short row": (_rows("image,fz,depth\npress.png,1\n"), "line 2"),
    "a column twice": (_rows("image,fz,fz,depth\npress.png,1,1,1\n"), "twice"),
    "a force that is text": (_rows(ROWS.format("much")), "much"),
    "a force without end": (_rows(ROWS.format("inf")), "no finite number"),
    "a decimal comma": (_rows(ROWS.format('"1,5"')), "1,5"),
    "bytes for text": (_bytes("presses.csv", b"\xff\xfe\x00image"), "no CSV in UTF-8"),
    "no gel at rest": (_toml('no_contact = "rest.png"', ""), "no image of the gel at rest"),
    "a press that never is": (
        _toml('image = "image"', 'image = "image"\nstate = "image"'),
        "no row whose state",
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_is_refused_by_name(name: str, small: Path, tmp_path: Path) -> None:
    """The message names field or file, there is a word on what to do, and no run is left."""
    harm, told = CASES[name]
    harm(small)
    runs = tmp_path / "runs"
    with pytest.raises(RigError) as refused:
        import_run(small, parent=runs)
    assert told in refused.value.message
    assert refused.value.remedy or "TOML" in told
    assert not list(runs.glob("*"))
    assert not (small / "x").exists()


PAGE = Path(__file__).parents[3] / "docs" / "importing.md"
BEGIN, END = "<!-- refused: begin -->", "<!-- refused: end -->"


def _table() -> str:
    """Return the cases as the page has them."""
    rows = [f"| {name} | `{told}` |" for name, (_, told) in CASES.items()]
    return "\n".join(["", "| source | the message has |", "|---|---|", *rows, ""])


def test_the_page_lists_every_case() -> None:
    """``python -m tests.tacauchy_rig.importing.test_hostile`` writes it anew."""
    page = PAGE.read_text("utf-8")
    assert page.partition(BEGIN)[2].partition(END)[0] == _table()


if __name__ == "__main__":
    before, _, after = PAGE.read_text("utf-8").partition(BEGIN)
    PAGE.write_text(f"{before}{BEGIN}{_table()}{END}{after.partition(END)[2]}", "utf-8")
