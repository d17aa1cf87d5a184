"""The presses of a sweep as episodes: one sample before contact and one pressed, a second apart."""

import json
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from sim.scene.indenter import tilted
from tacauchy_rig.app.exporting.episode_and_import_toml import Episode
from tacauchy_rig.app.importing.image_conversion import opened
from tacauchy_rig.app.importing.press_detection import Samples
from tacauchy_rig.app.sweep.engine_names import INDEX
from tacauchy_rig.app.sweep.shards import LARGE, WRENCH, parquet
from tacauchy_rig.core.errors import RecordError, whole
from tacauchy_rig.core.run import ImageFrame

STAMPS_NS = np.array([0, 10**9])


def presses_of(folder: Path) -> Iterator[Episode]:
    """Yield the valid presses of a data set, in the order of its files.

    Wrenches are those on the indenter, in the pad's frame; poses count from first touch.

    Raises:
        RecordError: None is valid, or a file is damaged.
    """
    remedy = "run the sweep once more: it writes the index again"
    with whole(str(folder / INDEX), "index of a sweep", remedy=remedy):
        rows = parquet().parquet.read_table(folder / INDEX).to_pylist()
    valid = sorted((r for r in rows if r["valid"]), key=lambda r: (r["shard"], r["offset"]))
    if not valid:
        raise RecordError(f"{folder}: none of its presses is valid", remedy="see summary.html")
    yield from (_press(folder, row) for row in valid)


def _press(folder: Path, row: dict[str, Any]) -> Episode:
    turn = Rotation.from_matrix(tilted(row["tilt_x_rad"], row["tilt_y_rad"]))
    twisted = Rotation.from_rotvec([0.0, 0.0, row["twist_rad"]]) * turn
    x, y = row["x_m"], row["y_m"]
    pose = [
        [x, y, 0.0, *turn.as_rotvec()],
        [x + row["shift_x_m"], y + row["shift_y_m"], -row["depth_m"], *twisted.as_rotvec()],
    ]
    rest, pressed = (int(stamp) for stamp in STAMPS_NS)
    return Episode(
        name=row["hash"],
        force=Samples(stamp_ns=STAMPS_NS, value=np.array([[0.0] * 6, [row[n] for n in WRENCH]])),
        pose=Samples(stamp_ns=STAMPS_NS, value=np.array(pose)),
        velocity=np.zeros((2, 6)),
        arm_wrench=np.full((2, 6), np.nan),
        frames=lambda: _frames(folder, row),
        stamps_ns=STAMPS_NS,
        windows={"tare": (rest, rest), "reference": (rest, rest), "dwell": (pressed, pressed)},
        outputs={**row, "run": folder.resolve().name},
        fields=lambda: _fields(folder, row),
    )


def _frames(folder: Path, row: dict[str, Any]) -> Iterator[ImageFrame]:
    table, place = _shard(folder / row["shard"]), row["offset"]
    for number, name in enumerate(("reference", "image")):
        content = table[name][place].as_py()
        (width, height), _turned = opened(content, name=name)
        yield ImageFrame(
            stamp_ns=int(STAMPS_NS[number]),
            counter=number,
            device_stamp_s=None,
            width=width,
            height=height,
            jpeg=content,
        )


def _fields(folder: Path, row: dict[str, Any]) -> dict[str, Any]:
    table, found = _shard(folder / row["shard"]), {}
    for name in LARGE[2:]:
        shape = json.loads(table.schema.field(name).metadata[b"shape"])
        found[name] = (
            table[name][row["offset"]].values.to_numpy(zero_copy_only=False).reshape(shape)
        )
    return found


@lru_cache(maxsize=1)
def _shard(file: Path) -> Any:
    return parquet().parquet.read_table(file, columns=list(LARGE))
