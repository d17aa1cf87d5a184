"""A LeRobot dataset of version 3: one press an episode, rows at the camera's rate.

A row has what was newest at its time; ``observation.wrench_window`` has the samples of force since
the row before. Forces are without their zero before the press. Layout of codebase_version v3.0.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tacauchy_rig.app.exporting.episode import Episode, Rows, even_rows, images_of, needed
from tacauchy_rig.app.exporting.import_spec import write_spec
from tacauchy_rig.app.importing.lerobot import (
    DATA,
    EPISODES,
    INDEX,
    INFO,
    PLACE,
    TIME,
    VERSION,
    VIDEOS,
)
from tacauchy_rig.core.arrays import AnyArray, ImageArray
from tacauchy_rig.core.store.recording.messages import POSE_FIELDS, WRENCH_FIELDS
from tacauchy_rig.core.store.run_store import RunStore

IMAGE, WRENCH = "observation.images.tactile", "observation.wrench"
WINDOW, STATE = "observation.wrench_window", "observation.state"
_TASK = "press the tactile sensor"
_CODEC: Mapping[str, str] = {"crf": "12", "g": "2", "preset": "veryfast"}
"""Of H.264: nearly without loss, and every second frame stands alone."""
_FIRST = dict.fromkeys(PLACE, 0)
_VIDEO = {"video.codec": "h264", "video.pix_fmt": "yuv420p", "video.is_depth_map": False}
_STATISTICS: Mapping[str, Any] = {"min": np.min, "max": np.max, "mean": np.mean, "std": np.std}
_SEEN_EVERY = 10
"""Of the images whose levels make the statistics; all are much alike."""


def write_lerobot(presses: Iterable[Episode], out: Path, store: RunStore | None) -> None:
    """Write presses as a dataset, and how to import those of a run."""
    episodes = list(presses)
    rate, rows = even_rows(episodes)
    columns = _columns(rows)
    images = (img for each, own in zip(episodes, rows, strict=True) for img in images_of(each, own))
    path = out / VIDEOS.format(video_key=IMAGE, **_FIRST)
    shape, levels = _write_video(path, images, rate)
    _write_parquet(out / DATA.format(**_FIRST), columns)
    _write_parquet(out / EPISODES / "chunk-000/file-000.parquet", _places(rows, rate))
    tasks = {"task_index": np.array([0]), "task": [_TASK]}
    _write_parquet(out / "meta/tasks.parquet", tasks, index="task")
    stats = {IMAGE: levels} | {name: _statistics(values) for name, values in columns.items()}
    features: dict[str, Any] = {
        IMAGE: {"dtype": "video", "shape": shape, "names": ["height", "width", "channels"]}
    }
    features[IMAGE]["info"] = {**_VIDEO, "video.fps": rate, "has_audio": False}
    names = {WRENCH: WRENCH_FIELDS, STATE: POSE_FIELDS, "action": POSE_FIELDS}
    for name, values in columns.items():
        size: dict[str, Any] = {"dtype": str(values.dtype), "shape": values.shape[1:] or (1,)}
        features[name] = {**size, "names": names.get(name)}
    info = {
        "codebase_version": f"{VERSION}0",
        "robot_type": None,
        "fps": rate,
        "total_episodes": len(episodes),
        "total_frames": len(columns["index"]),
        "total_tasks": 1,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "splits": {"train": f"0:{len(episodes)}"},
        "data_path": DATA,
        "video_path": VIDEOS,
        "features": features,
    }
    for name, content in ((INFO, info), ("meta/stats.json", stats)):
        (out / name).write_text(json.dumps(content, indent=1))
    data: dict[str, object] = {"image": IMAGE, "force": {"feature": WRENCH, "unit": "N"}}
    if STATE in columns:
        data["pose"] = {"feature": STATE, "unit": "m"}
    if store is not None:
        write_spec(store, out, "lerobot", data)


def _columns(rows: list[Rows]) -> dict[str, AnyArray]:
    """Return all rows of all episodes by feature; the action is the next row's pose."""
    lengths = [len(each.time_s) for each in rows]
    numbers = {WRENCH: [each.wrench for each in rows], WINDOW: [each.window for each in rows]}
    states = [each.state for each in rows if each.state is not None]
    if len(states) == len(rows):
        numbers |= {STATE: states, "action": [np.vstack([s[1:], s[-1:]]) for s in states]}
    numbers[TIME] = [each.time_s for each in rows]
    return {k: np.concatenate(parts).astype(np.float32) for k, parts in numbers.items()} | {
        "frame_index": np.concatenate([np.arange(length) for length in lengths]),
        INDEX: np.repeat(np.arange(len(rows)), lengths),
        "index": np.arange(sum(lengths)),
        "task_index": np.zeros(sum(lengths), dtype=np.int64),
    }


def _places(rows: list[Rows], rate: int) -> dict[str, Any]:
    """Return where each episode lies in the files."""
    lengths = np.array([len(each.time_s) for each in rows])
    ends, zero = np.cumsum(lengths), np.zeros(len(rows), dtype=np.int64)
    within = {"from_timestamp": (ends - lengths) / rate, "to_timestamp": ends / rate}
    files = ("data", f"videos/{IMAGE}", "meta/episodes")
    return {
        INDEX: np.arange(len(rows)),
        "tasks": [[_TASK]] * len(rows),
        "length": lengths,
        "dataset_from_index": ends - lengths,
        "dataset_to_index": ends,
        **{f"{of}/{part}": zero for of in files for part in PLACE},
        **{f"videos/{IMAGE}/{name}": values for name, values in within.items()},
    }


def _write_video(
    path: Path, images: Iterator[ImageArray], rate: int
) -> tuple[tuple[int, ...], dict[str, Any]]:
    """Write images as H.264; return the shape of one, and statistics of their levels (0 to 1)."""
    av = needed("av")
    path.parent.mkdir(parents=True)
    seen: list[AnyArray] = []
    with av.open(str(path), "w") as file:
        stream = file.add_stream("libx264", rate=rate, options=dict(_CODEC))
        stream.pix_fmt = "yuv420p"
        for number, image in enumerate(images):
            if not seen:
                stream.height, stream.width = image.shape[:2]
            file.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
            if number % _SEEN_EVERY == 0:
                seen.append(image[::4, ::4].reshape(-1, 3) / 255.0)
        file.mux(stream.encode())
    of_levels = _statistics(np.concatenate(seen))
    count = of_levels.pop("count")
    return image.shape, {k: np.reshape(v, (3, 1, 1)).tolist() for k, v in of_levels.items()} | {
        "count": count
    }


def _statistics(values: AnyArray) -> dict[str, Any]:
    """Return what normalises a feature: over rows, of each of its numbers."""
    found = {name: np.atleast_1d(of(values, axis=0)) for name, of in _STATISTICS.items()}
    return {name: each.tolist() for name, each in found.items()} | {"count": [len(values)]}


def _write_parquet(path: Path, columns: Mapping[str, Any], *, index: str = "") -> None:
    """Write columns; ``index`` is the one that pandas takes for the names of rows."""
    arrow, parquet = needed("pyarrow"), needed("pyarrow.parquet")
    path.parent.mkdir(parents=True, exist_ok=True)
    table = arrow.table({name: _column(arrow, values) for name, values in columns.items()})
    if index:
        word = {"pandas_type": "unicode", "numpy_type": "object", "metadata": None}
        about: dict[str, Any] = {
            "columns": [{"name": index, "field_name": index, **word}],
            "column_indexes": [],
        }
        about["index_columns"] = [index]
        table = table.replace_schema_metadata({"pandas": json.dumps(about)})
    parquet.write_table(table, path)


def _column(arrow: Any, values: Any) -> Any:
    """Return a column; rows of an array of more dimensions become lists."""
    if not isinstance(values, np.ndarray):
        return values
    kind = arrow.from_numpy_dtype(values.dtype)
    for _ in values.shape[1:]:
        kind = arrow.list_(kind)
    return arrow.array(values.tolist(), type=kind)
