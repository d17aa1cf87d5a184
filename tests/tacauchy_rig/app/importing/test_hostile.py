"""Damaged, hostile and half-empty sources each end with a message that names what is wrong."""

import os
import zipfile
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tacauchy_rig.app.importing.importer import import_run
from tacauchy_rig.core.errors import RigError
from tests.studies.hostile_runs.kinds import png
from tests.tacauchy_rig.app.importing.conftest import make_small
from tests.tacauchy_rig.app.importing.sources import make_lerobot, make_records, record

ROWS = "image,fz,depth\npress.png,{},0.25\n"


def _text(name: str, old: str, new: str) -> Callable[[Path], None]:
    def harm(folder: Path) -> None:
        path = folder / name
        assert old in path.read_text()
        path.write_text(path.read_text().replace(old, new))

    return harm


_toml, _info = partial(_text, "import.toml"), partial(_text, "meta/info.json")


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


def _cut_png(folder: Path) -> None:
    data = (folder / "press.png").read_bytes()
    (folder / "press.png").write_bytes(data[: len(data) // 2])


class _Evil:
    """What writes a file if it is ever unpickled."""

    def __reduce__(self) -> tuple[Any, tuple[str]]:
        return exec, ("open('x', 'w').close()",)


def _pickled(folder: Path) -> None:
    np.save(folder / "feats/9_sphere_10.npy", np.array(_Evil(), dtype=object), allow_pickle=True)


def _pickled_member(folder: Path) -> None:
    np.savez(folder / RECORD, **record(image=np.array(_Evil(), dtype=object)))


def _record(**changed: Any) -> Callable[[Path], None]:
    return lambda folder: np.savez(folder / RECORD, **record(**changed))


def _bomb(folder: Path) -> None:
    """An archive of 2 MB whose array unpacks to 2 GB: one packed block of zeros, repeated."""
    packer = zlib.compressobj(wbits=-15)
    block = packer.compress(bytes(2**20)) + packer.flush(zlib.Z_FULL_FLUSH)
    with zipfile.ZipFile(folder / RECORD, "w") as file:
        file.writestr("image.npy", block * 2048 + packer.flush())
        member = file.getinfo("image.npy")
        member.compress_type, member.file_size = zipfile.ZIP_DEFLATED, 2048 * 2**20


def _parquet(path: str, change: Callable[[pa.Table], pa.Table]) -> Callable[[Path], None]:
    def harm(folder: Path) -> None:
        pq.write_table(change(pq.read_table(folder / path)), folder / path)

    return harm


def _without(column: str) -> Callable[[pa.Table], pa.Table]:
    return lambda table: table.drop_columns([column])


def _with(column: str, value: Any) -> Callable[[pa.Table], pa.Table]:
    def change(table: pa.Table) -> pa.Table:
        place = table.column_names.index(column)
        return table.set_column(place, column, pa.array([value] * len(table)))

    return change


def _wide_foot(folder: Path) -> None:
    """More rows than any recording has: zeros, packed to a few kilobytes."""
    rows = 2_100_000
    zeros = pa.table({"episode_index": np.zeros(rows, np.int64), "timestamp": np.zeros(rows)})
    names = ("observation.wrench", "observation.state", IMAGES)
    for name in names:
        zeros = zeros.append_column(name, pa.array(np.zeros(rows)))
    pq.write_table(zeros, folder / DATA)


def _data_link(folder: Path) -> None:
    outside = folder.parent / "outside.parquet"
    (folder / DATA).rename(outside)
    (folder / DATA).symlink_to(outside)


RECORD = "feats/1_sphere_10.npz"
IMAGES = "observation.images.tactile"
DATA = "data/chunk-000/file-000.parquet"
EPISODES = "meta/episodes/chunk-000/file-000.parquet"
Harm = tuple[Callable[[Path], None], str]
CASES: dict[str, Harm] = {
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
    "an image that claims to be vast": (
        _bytes("press.png", png(100_000, 100_000)),
        "decompression bomb",
    ),
    "no row": (_rows("image,fz,depth\n"), "no row below its head line"),
    "a short row": (_rows("image,fz,depth\npress.png,1\n"), "line 2"),
    "a column twice": (_rows("image,fz,fz,depth\npress.png,1,1,1\n"), "twice"),
    "a force that is text": (_rows(ROWS.format("much")), "much"),
    "a force without end": (_rows(ROWS.format("inf")), "no finite number"),
    "a comma of decimals or thousands": (_rows(ROWS.format('"1,500"')), "may be a decimal comma"),
    "an underscore in a number": (_rows(ROWS.format("1_5")), "'1_5' is no finite number"),
    "a force beyond all": (_rows(ROWS.format("1e308")), "more than any press"),
    "bytes for text": (_bytes("presses.csv", b"\x00\x01image"), "no CSV in UTF-8"),
    "no gel at rest": (_toml('no_contact = "rest.png"', ""), "no image of the gel at rest"),
    "a press that never is": (
        _toml('image = "image"', 'image = "image"\nstate = "image"'),
        "no row whose state",
    ),
}

RECORD_CASES: dict[str, Harm] = {
    "a record that is a pickle": (_pickled, "pickles are never loaded"),
    "a record with a pickle in it": (_pickled_member, "pickles are never loaded"),
    "a record without its image's key": (_toml('image = "image"', 'image = "img"'), "'img'"),
    "a record whose image is a map": (_record(image=np.zeros((4, 5))), "[4, 5] of float64"),
    "a record without its force": (_toml('column = "fz"', 'column = "Fz"'), "'Fz'"),
    "a record whose force is no number": (_record(fz=np.inf), "no finite number"),
    "a record that unpacks to 2 GB": (_bomb, "unpacks to 2147483648 bytes"),
    "a record that was cut off": (_bytes(RECORD, b"PK\3\4"), "no whole zip archive"),
    "a record of no known indenter": (_toml("sphere_10", "star_3"), "data.indenters"),
    "records that all slide": (_toml('"dx", "dy"', '"dz", "dy"'), "move aside or turn"),
    "records elsewhere": (_toml('"feats"', '"../feats"'), "leads out of the folder"),
    "no record": (_toml('"feats"', '"."'), "data.records"),
}
LEROBOT_CASES: dict[str, Harm] = {
    "a dataset of version 2": (_info("v3.0", "v2.1"), "'v2.1'"),
    "a dataset whose info is no JSON": (_bytes("meta/info.json", b"{" * 5000), "meta/info.json"),
    "a dataset without that force": (_toml("observation.wrench", "force"), "column force"),
    "a dataset without that episode": (_toml("[data]", "[data]\nepisodes = [7]"), "not 7"),
    "a force of words": (
        _parquet(DATA, _with("observation.wrench", ["a"] * 6)),
        "observation.wrench: no",
    ),
    "a force that is not known": (
        _parquet(DATA, _with("observation.wrench", [float("nan")] * 6)),
        "samples of force",
    ),
    "times that stand still": (_parquet(DATA, _with("timestamp", 1.0)), "do not ascend"),
    "a column less": (_parquet(DATA, _without("timestamp")), "no column timestamp"),
    "images by path": (
        _parquet(DATA, _with(IMAGES, {"bytes": None, "path": "/etc/hostname"})),
        "holds no image's bytes",
    ),
    "Parquet that was cut off": (_bytes(DATA, b"PAR1 and no more"), "no whole Parquet file"),
    "Parquet of too many rows": (_wide_foot, "2100000 rows"),
    "Parquet that lies elsewhere": (_data_link, "leads out of the folder"),
    "a chunk that is not there": (_parquet(EPISODES, _with("data/file_index", 3)), "file-003"),
    "a video that is not there": (_info('"dtype": "image"', '"dtype": "video"'), "file-000.mp4"),
}
ALL: dict[str, tuple[Callable[[Path], Path], Harm]] = {
    **{name: (make_small, case) for name, case in CASES.items()},
    **{name: (make_records, case) for name, case in RECORD_CASES.items()},
    **{name: (make_lerobot, case) for name, case in LEROBOT_CASES.items()},
}


@pytest.mark.parametrize("name", ALL)
def test_is_refused_by_name(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The message names field or file and what to do; nothing is executed, no run is left."""
    monkeypatch.chdir(tmp_path)
    make, (harm, told) = ALL[name]
    folder, runs = make(tmp_path / "source"), tmp_path / "runs"
    harm(folder)
    with pytest.raises(RigError) as refused:
        import_run(folder, parent=runs)
    assert told in refused.value.message
    assert refused.value.remedy or "TOML" in told
    assert not list(runs.glob("*"))
    assert not (tmp_path / "x").exists()


PAGE = Path(__file__).parents[4] / "docs" / "results" / "importing.md"
BEGIN, END = "<!-- refused: begin -->", "<!-- refused: end -->"


def _table() -> str:
    """Return the cases as the page has them."""
    cases = {**CASES, **RECORD_CASES, **LEROBOT_CASES}
    rows = [f"| {name} | `{told}` |" for name, (_, told) in cases.items()]
    return "\n".join(["", "| source | the message has |", "|---|---|", *rows, ""])


def test_the_page_lists_every_case() -> None:
    """``python -m tests.tacauchy_rig.app.importing.test_hostile`` writes it anew."""
    page = PAGE.read_text("utf-8")
    assert page.partition(BEGIN)[2].partition(END)[0] == _table()


if __name__ == "__main__":
    before, _, after = PAGE.read_text("utf-8").partition(BEGIN)
    PAGE.write_text(f"{before}{BEGIN}{_table()}{END}{after.partition(END)[2]}", "utf-8")
