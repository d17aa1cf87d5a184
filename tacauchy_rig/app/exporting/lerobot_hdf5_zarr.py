"""Presses as LeRobot, HDF5, Zarr and WebDataset: what policies are trained with.

LeRobot is of version 3 (codebase_version v3.0): one press an episode, rows at the camera's rate. A
row has what was newest at its time, ``observation.wrench_window`` the samples of force since the
row before. Forces are without their zero before the press. HDF5 has robomimic's layout, one demo a
press; beside its even rows ``samples`` has all samples at their own times, ``simulated`` the fields
of the replay, and the attribute ``unit`` says what numbers are in. Zarr has LeRobot's features as
arrays over all rows, in diffusion policy's layout: ``meta/episode_ends`` says where presses end.
WebDataset is a tar file, one
sample a press under one key; ``rest`` is the newest image without contact, ``pressed`` the middle
one of the dwell.
"""

import io
import json
import tarfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tacauchy_rig.app.exporting.episode_and_import_toml import (
    Episode,
    Rows,
    even_rows,
    images_of,
    needed,
    write_spec,
)
from tacauchy_rig.app.importing import lerobot
from tacauchy_rig.core.arrays import AnyArray, ImageArray
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import ImageFrame
from tacauchy_rig.core.store.recording.mcap_writer import POSE_FIELDS, WRENCH_FIELDS
from tacauchy_rig.core.store.run_store import RunStore, pack_array

IMAGE, WRENCH = "observation.images.tactile", "observation.wrench"
WINDOW, STATE = "observation.wrench_window", "observation.state"
_TASK = "press the tactile sensor"
_CODEC: Mapping[str, str] = {"bf": "0", "crf": "12", "g": "2", "preset": "veryfast"}
"""Of H.264: nearly without loss, every second frame stands alone, none refers to a later one."""
_FIRST = dict.fromkeys(lerobot.PLACE, 0)
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
    path = out / lerobot.VIDEOS.format(video_key=IMAGE, **_FIRST)
    shape, levels = _write_video(path, images, rate)
    _write_parquet(out / lerobot.DATA.format(**_FIRST), columns)
    _write_parquet(out / lerobot.EPISODES / "chunk-000/file-000.parquet", _places(rows, rate))
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
        "codebase_version": f"{lerobot.VERSION}0",
        "robot_type": None,
        "fps": rate,
        "total_episodes": len(episodes),
        "total_frames": len(columns["index"]),
        "total_tasks": 1,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "splits": {"train": f"0:{len(episodes)}"},
        "data_path": lerobot.DATA,
        "video_path": lerobot.VIDEOS,
        "features": features,
    }
    for name, content in ((lerobot.INFO, info), ("meta/stats.json", stats)):
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
    numbers[lerobot.TIME] = [each.time_s for each in rows]
    return {k: np.concatenate(parts).astype(np.float32) for k, parts in numbers.items()} | {
        "frame_index": np.concatenate([np.arange(length) for length in lengths]),
        lerobot.INDEX: np.repeat(np.arange(len(rows)), lengths),
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
        lerobot.INDEX: np.arange(len(rows)),
        "tasks": [[_TASK]] * len(rows),
        "length": lengths,
        "dataset_from_index": ends - lengths,
        "dataset_to_index": ends,
        **{f"{of}/{part}": zero for of in files for part in lerobot.PLACE},
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
    levels = _statistics(np.concatenate(seen))
    of_channels = {name: np.reshape(levels[name], (3, 1, 1)).tolist() for name in _STATISTICS}
    return image.shape, levels | of_channels


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
        column = {"name": index, "field_name": index, **word}
        about = {"columns": [column], "column_indexes": [], "index_columns": [index]}
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


WRENCH_UNIT, STATE_UNIT = "N, N, N, N m, N m, N m", "m, m, m, rad, rad, rad"
_UNITS = {"_m": "m", "_pa": "Pa", "_n": "N", "_s": "s"}
_IMAGE = {"compression": "gzip", "compression_opts": 1}


class _Patient(io.FileIO):
    """A file that keeps its error: HDF5 ends the program where a full disk keeps it from closing.

    Attributes:
        failed: What the first write that failed raised.
    """

    failed: OSError | None = None

    def write(self, content: Any) -> int:
        """Write all of the content, or keep why not."""
        left = memoryview(content).cast("B")
        try:
            while left and self.failed is None:
                left = left[super().write(left) :]
        except OSError as error:
            self.failed = error
        return memoryview(content).nbytes

    def truncate(self, size: int | None = None) -> int:
        """Set the size, or keep why not."""
        try:
            return super().truncate(size)
        except OSError as error:
            self.failed = error
            return size or 0


def write_hdf5(presses: Iterable[Episode], out: Path, _store: RunStore | None) -> None:
    """Write presses into ``presses.hdf5``."""
    h5py, episodes = needed("h5py"), list(presses)
    rate, rows = even_rows(episodes)
    with _Patient(out / "presses.hdf5", "w+") as raw, h5py.File(raw, "w") as file:
        data = file.create_group("data")
        data.attrs["total"] = sum(len(each.time_s) for each in rows)
        data.attrs["rate_hz"] = rate
        sensor = episodes[0].outputs["sensor"]
        data.attrs["env_args"] = json.dumps({"env_name": sensor, "type": 2, "env_kwargs": {}})
        for number, (episode, own) in enumerate(zip(episodes, rows, strict=True)):
            if raw.failed is None:
                _write_demo(data.create_group(f"demo_{number}"), episode, own)
    if raw.failed is not None:
        raise raw.failed


def _write_demo(group: Any, episode: Episode, rows: Rows) -> None:
    """Write one press."""
    count = len(rows.time_s)
    group.attrs["num_samples"] = count
    for name, value in episode.outputs.items():
        group.attrs[name] = np.nan if value is None else value
    for name, (start_ns, end_ns) in episode.windows.items():
        group.attrs[f"{name}_ns"] = [start_ns, end_ns]
    units = {"obs/time": "s", "obs/wrench": WRENCH_UNIT, "obs/wrench_window": WRENCH_UNIT}
    values: dict[str, AnyArray] = {"obs/time": rows.time_s, "obs/wrench": rows.wrench}
    values["obs/wrench_window"] = rows.window
    ends = (np.arange(count) == count - 1).astype(np.int64)
    values |= {"dones": ends, "rewards": np.zeros(count), "samples/image_stamp": episode.stamps_ns}
    samples = {"force": (episode.force, WRENCH_UNIT), "pose": (episode.pose, STATE_UNIT)}
    for name, (stream, unit) in samples.items():
        if stream is not None:
            values |= {f"samples/{name}": stream.value, f"samples/{name}_stamp": stream.stamp_ns}
            units |= {f"samples/{name}": unit, f"samples/{name}_stamp": "ns"}
    if rows.state is not None:
        values |= {"obs/state": rows.state, "actions": np.vstack([rows.state[1:], rows.state[-1:]])}
        units |= {"obs/state": STATE_UNIT, "actions": STATE_UNIT}
    units["samples/image_stamp"] = "ns"
    for name, array in episode.fields().items():
        values[f"simulated/{name}"] = array
        units |= {f"simulated/{name}": unit for end, unit in _UNITS.items() if name.endswith(end)}
    for name, array in values.items():
        group.create_dataset(name, data=array).attrs["unit"] = units.get(name, "1")
    images = None
    for number, image in enumerate(images_of(episode, rows)):
        if images is None:
            shape = (count, *image.shape)
            images = group.create_dataset(
                "obs/tactile", shape, np.uint8, chunks=(1, *image.shape), **_IMAGE
            )
            images.attrs["unit"] = "grey levels, RGB"
        images[number] = image


def write_zarr(presses: Iterable[Episode], out: Path, _store: RunStore | None) -> None:
    """Write presses into ``presses.zarr``."""
    zarr, episodes = needed("zarr"), list(presses)
    rate, rows = even_rows(episodes)
    root = zarr.create_group(str(out / "presses.zarr"), attributes={"rate_hz": rate})
    ends = np.cumsum([len(each.time_s) for each in rows])
    root.create_array("meta/episode_ends", data=ends)
    for name, values in _columns(rows).items():
        root.create_array(f"data/{name}", data=values)
    shown = (img for each, own in zip(episodes, rows, strict=True) for img in images_of(each, own))
    for number, image in enumerate(shown):
        if not number:
            shape = {"shape": (int(ends[-1]), *image.shape), "chunks": (1, *image.shape)}
            images = root.create_array(f"data/{IMAGE}", dtype="uint8", **shape)
        images[number] = image


def write_webdataset(presses: Iterable[Episode], out: Path, _store: RunStore | None) -> None:
    """Write presses into ``presses-000000.tar``."""
    with tarfile.open(out / "presses-000000.tar", "w") as tar:
        for episode in presses:
            for ending, content in _members(episode):
                member = tarfile.TarInfo(f"{episode.outputs['run']}-{episode.name}.{ending}")
                member.size = len(content)
                tar.addfile(member, io.BytesIO(content))


def _members(episode: Episode) -> Iterator[tuple[str, bytes]]:
    """Yield what makes the sample of a press, each with its ending."""
    for name, window, share in (("rest", "reference", 1.0), ("pressed", "dwell", 0.5)):
        frame = _image(episode, window, share)
        yield f"{name}.{frame.kind.replace('jpeg', 'jpg')}", frame.jpeg
    yield "json", json.dumps(dict(episode.outputs), allow_nan=False).encode()
    arrays = {"wrench_n_nm": episode.tared.within(episode.windows["dwell"]).value}
    for name, array in {**arrays, **episode.fields()}.items():
        yield f"{name}.npy", pack_array(array)


def _image(episode: Episode, window: str, share: float) -> ImageFrame:
    """Return the image at a share of a window. RecordError: There is none."""
    start_ns, end_ns = episode.windows.get(window, (1, 0))
    inside = np.flatnonzero((episode.stamps_ns >= start_ns) & (episode.stamps_ns <= end_ns))
    if not len(inside):
        raise RecordError(
            f"{episode.name}: has no image in its {window}",
            remedy="leave the trial out of the run, or export it --to csv",
        )
    wanted = inside[round(share * (len(inside) - 1))]
    return next(f for n, f in enumerate(episode.frames()) if n == wanted)
